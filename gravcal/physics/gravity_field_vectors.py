"""Two inner loops of the gravity field in vectors of LANES points, as instructions for numba's compiler (LLVM).

Addresses are those of contiguous float64 arrays (``array.ctypes.data``); nothing is checked, the caller sees to sizes.
LLVM splits the vectors into whatever registers the processor has.
"""

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

LANES = 8  # points side by side
TILE = 6  # sums side by side: with 256-bit registers 6 x 8 sums, a row and a coefficient fill all sixteen
BLOCK = 128  # points that share the coefficients of an order while these are in the nearest memory

DOUBLE, INDEX = ir.DoubleType(), ir.IntType(64)
VECTOR = ir.VectorType(DOUBLE, LANES)
FUSED = ("contract",)  # a product and a sum may be rounded once


@intrinsic
def recur(typing, z, q, alpha, beta, degrees, rows):  # noqa: ARG001 numba passes them to code()
    """Write a_n of LANES points: rows (degrees, LANES) from z', q' (LANES,) and alpha, beta (degrees,)."""

    def code(context, b, _, addresses):
        z, q, alpha, beta, rows = (_pointer(b, addresses[k]) for k in (0, 1, 2, 3, 5))
        along, across, one = _load(b, z, _index(0)), _load(b, q, _index(0)), _spread(b, ir.Constant(DOUBLE, 1.0))
        _store(b, one, rows, _index(0))

        def step(n, kept):
            last, before = kept
            first = b.fmul(b.fmul(_spread(b, _one(b, alpha, n)), along), last, flags=FUSED)
            second = b.fmul(b.fmul(_spread(b, _one(b, beta, n)), across), before)
            found = b.fsub(first, second, flags=FUSED)
            _store(b, found, rows, b.mul(n, _index(LANES)))
            return [found, last]

        _loop(b, (1, addresses[4]), [one, ir.Constant(VECTOR, None)], step)
        return context.get_dummy_value()

    return types.void(*[types.intp] * 6), code


@intrinsic
def lump(typing, tile, rows, degrees, out):  # noqa: ARG001 numba passes them to code()
    """Write sum_n c_kn a_n of LANES points: out (TILE, BLOCK), its first LANES columns, from tile (degrees, TILE)."""

    def code(context, b, _, addresses):
        tile, rows, out = (_pointer(b, addresses[k]) for k in (0, 1, 3))

        def step(n, sums):
            row, at = _load(b, rows, b.mul(n, _index(LANES))), b.mul(n, _index(TILE))
            factors = [_spread(b, _one(b, tile, b.add(at, _index(k)))) for k in range(TILE)]
            terms = [b.fmul(factor, row, flags=FUSED) for factor in factors]
            return [b.fadd(term, old, flags=FUSED) for term, old in zip(terms, sums, strict=True)]

        sums = _loop(b, (0, addresses[2]), [ir.Constant(VECTOR, None)] * TILE, step)
        for k, one in enumerate(sums):
            _store(b, one, out, _index(k * BLOCK))
        return context.get_dummy_value()

    return types.void(*[types.intp] * 4), code


def _loop(b, bounds, begin, step):
    """Code of a loop that hands vectors on; the vectors after it."""
    first, stop = _index(bounds[0]), bounds[1]
    before, head, after = b.block, b.append_basic_block("head"), b.append_basic_block("after")
    b.cbranch(b.icmp_signed("<", first, stop), head, after)
    b.position_at_end(head)
    n, kept = _either(b, INDEX, first, before), [_either(b, VECTOR, one, before) for one in begin]
    found = step(n, kept)
    following = b.add(n, _index(1))
    for joined, value in zip([n, *kept], [following, *found], strict=True):
        joined.add_incoming(value, head)
    b.cbranch(b.icmp_signed("<", following, stop), head, after)
    b.position_at_end(after)
    done = [_either(b, VECTOR, one, before) for one in begin]
    for joined, value in zip(done, found, strict=True):
        joined.add_incoming(value, head)
    return done


def _either(b, kind, value, block):
    """Value that depends on where the code came from, with the first of its sources."""
    joined = b.phi(kind)
    joined.add_incoming(value, block)
    return joined


def _index(number):
    return ir.Constant(INDEX, number)


def _pointer(b, address):
    return b.inttoptr(address, DOUBLE.as_pointer())


def _one(b, base, at):
    """Number at an index."""
    return b.load(b.gep(base, [at]))


def _spread(b, number):
    """Vector with one number in all its places."""
    alone = b.insert_element(ir.Constant(VECTOR, ir.Undefined), number, ir.Constant(ir.IntType(32), 0))
    places = ir.Constant(ir.VectorType(ir.IntType(32), LANES), None)
    return b.shuffle_vector(alone, ir.Constant(VECTOR, ir.Undefined), places)


def _load(b, base, at):
    """Vector from an index on."""
    found = b.load(b.bitcast(b.gep(base, [at]), VECTOR.as_pointer()))
    found.align = 8  # bytes: arrays begin anywhere
    return found


def _store(b, vector, base, at):
    """Vector to an index and those after it."""
    b.store(vector, b.bitcast(b.gep(base, [at]), VECTOR.as_pointer()), align=8)
