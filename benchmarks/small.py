"""`gravcal` with one more calibration, ``small``; also what its worker processes import anew."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "small_flow"))

if __name__ == "__main__":
    sys.argv[0] = "gravcal"
    from flows.cli import main

    main()
