"""RL04 text files of one day, and netCDF files of missions that have no format of their own."""

from pathlib import Path

import xarray as xr

_ORBIT = "gps_time:seconds GRACEFO_id:char coord_ref:char " + " ".join(
    f"{axis}{kind}:{unit}" for kind, unit in (("pos", "m"), ("pos_err", "m"), ("vel", "m/s"), ("vel_err", "m/s"))
    for axis in "xyz"
) + " qualflg:"  # fmt: skip
COLUMNS = {
    "ACC1A": "rcvtime_intg:seconds rcvtime_frac:microseconds time_ref:char GRACEFO_id:char qualflg: prod_flag: "
    "lin_accl_x:m/s2 lin_accl_y:m/s2 lin_accl_z:m/s2 ang_accl_x:rad/s2 ang_accl_y:rad/s2 ang_accl_z:rad/s2 icu_blk_nr:",
    "SCA1B": "gps_time:seconds GRACEFO_id:char sca_id: quatangle: quaticoeff: quatjcoeff: quatkcoeff: qual_rss: "
    "qualflg:",
    "MAG1B": "time_intg:seconds time_frac:nanoseconds GRACEFO_id:char time_ref:char MfvX_RAW:microTesla "
    "MfvY_RAW:microTesla MfvZ_RAW:microTesla torque1A:mA torque2A:mA torque3A:mA torque1B:mA torque2B:mA torque3B:mA "
    "MF_BCalX: MF_BCalY: MF_BCalZ: torque_cal: qualflg:",
    "GNV1B": _ORBIT,
    "GNI1B": _ORBIT,
    "CLK1B": "rcv_time:seconds GRACEFO_id:char clock_id: eps_time:seconds eps_err:seconds eps_drift:s/s drift_err:s/s "
    "qualflg:",
    "TIM1B": "obctime:seconds GRACEFO_id:char TS_suppid: rcvtime_intg:seconds rcvtime_frac:nanoseconds "
    "first_icu_blknr: final_icu_blknr: qualflg:",
    "KBR1B": "gps_time:second biased_range:m range_rate:m/s range_accl:m/s2 iono_corr: lighttime_corr:m "
    "lighttime_rate:m/s lighttime_accl:m/s2 ant_centr_corr:m ant_centr_rate:m/s ant_centr_accl:m/s2 "
    "K_A_SNR:0.1db-Hz Ka_A_SNR:0.1db-Hz K_B_SNR:0.1db-Hz Ka_B_SNR:0.1db-Hz qualflg:",
}


def _variables(product):
    lines = []
    for number, column in enumerate(COLUMNS[product].split(), 1):
        name, unit = column.split(":")
        lines += [f"    - {name}:", f"        comment: column {number}"]
        lines += [f"        units: {unit}"] if unit else []
    return lines


def header(product, satellite, count, first, last):
    """Text of the YAML header, end mark included."""
    platform = f"GRACE {'C+D' if satellite == 'Y' else satellite}"
    fixed = {"platform": platform, "product_version": "04", "title": f"GRACE-FO {product}"}
    lines = ["header:", "  dimensions:", f"    num_records: {count}", "  global_attributes:"]
    lines += [f"    {key}: {text}" for key, text in fixed.items()]
    lines += ["  non-standard_attributes:", "    epoch_time: 2000-01-01T12:00:00.00"]
    lines += [f"    start_time_epoch_secs: {first}", f"    stop_time_epoch_secs: {last}"]
    return "\n".join([*lines, "  variables:", *_variables(product), "# End of YAML header\n"])


class Writer:
    """Collects rows of each product and writes the files."""

    def __init__(self, folder, satellite, date, day):
        self.folder, self.satellite, self.date, self.day = Path(folder), satellite, date, int(day)
        self.rows = {product: [] for product in COLUMNS}

    def add(self, product, rows):
        """Append lines."""
        self.rows[product].extend(rows)

    def finish(self):
        """Write everything; return paths by product."""
        self.folder.mkdir(parents=True, exist_ok=True)
        paths = {}
        for product, rows in ((name, rows) for name, rows in self.rows.items() if rows):
            path = self.folder / f"{product}_{self.date}_{self.satellite}_04.txt"
            first, last = (row.split(maxsplit=1)[0] for row in (rows[0], rows[-1]))
            path.write_text(header(product, self.satellite, len(rows), first, last) + "\n".join(rows) + "\n")
            paths[product] = path
        return paths

    def _split(self, microseconds):
        whole, part = divmod(microseconds, 1_000_000)
        return (whole + self.day).tolist(), part.tolist()

    def accelerometer(self, index, tags_us, linear, angular):
        """ACC1A rows: SRF (x, y, z) goes to columns (z, x, y)."""
        whole, part = self._split(tags_us)
        flags = f"R  {self.satellite}  00000000   00000100000000000000000000111111"
        table = zip(whole, part, linear.tolist(), angular.tolist(), (index // 10 % 86400).tolist(), strict=True)
        self.add(
            "ACC1A",
            [f"{i}  {f}  {flags}  {y!r} {z!r} {x!r} {b!r} {c!r} {a!r} {n}" for i, f, (x, y, z), (a, b, c), n in table],
        )

    def star_camera(self, seconds, quaternions):
        """SCA1B rows."""
        for t, (s, x, y, z) in zip((seconds + self.day).tolist(), quaternions.tolist(), strict=True):
            self.rows["SCA1B"].append(f"{t} {self.satellite} 23 {s!r} {x!r} {y!r} {z!r} 8.773305180563576e-07 00000000")

    def magnetometer(self, tags_us, field, current):
        """MAG1B rows: A positive, B negative current with its sign."""
        whole, part = self._split(tags_us)
        for i, f, b, c in zip(whole, part, field.tolist(), current.tolist(), strict=True):
            both = [f"{v!r}" if v > 0 else "0" for v in c] + [f"{v!r}" if v < 0 else "0" for v in c]
            line = " ".join([f"{i} {f} {self.satellite} G", *(f"{v!r}" for v in b), *both])
            self.rows["MAG1B"].append(line + " 0 65000 -65000 -137.4900054931641  00000000")

    def orbit(self, product, seconds, position, velocity):
        """GNV1B or GNI1B rows."""
        ref, errors, flag = {
            "GNV1B": ("E", (5.7e-4, 7.0e-4, 9.9e-4, 1.36e-6, 1.96e-6, 2.02e-6), "00000000"),
            "GNI1B": ("I", (1e33,) * 6, "10000000"),
        }[product]
        a, b = (" ".join(f"{v!r}" for v in errors[k : k + 3]) for k in (0, 3))
        for t, p, v in zip((seconds + self.day).tolist(), position.tolist(), velocity.tolist(), strict=True):
            p, v = (" ".join(f"{x!r}" for x in triple) for triple in (p, v))
            self.rows[product].append(f"{t} {self.satellite} {ref} {p} {a} {v} {b}  {flag}")

    def clocks(self, clocks):
        """CLK1B (first record twice, as in the real files) and TIM1B of the whole day."""
        tail = f"1.6e-11 {clocks.drift!r} 1.65e-12 "
        clk = [(t + self.day, e) for t, e in zip(clocks.clock_time.tolist(), clocks.clock_offset.tolist(), strict=True)]
        flags = ["00000000"] * (len(clk) - 1) + ["00000001"]
        first = f"{clk[0][0]} {self.satellite} -1 {clk[0][1]!r} {tail} 00000010"
        rows = [f"{t} {self.satellite} -1 {e!r} {tail} {f}" for (t, e), f in zip(clk, flags, strict=True)]
        self.add("CLK1B", [first, *rows])
        for t, ns in zip(clocks.board_time.tolist(), clocks.board_offset_ns.tolist(), strict=True):
            whole, part = divmod((t + self.day) * 10**9 + ns, 10**9)
            self.rows["TIM1B"].append(f"{t + self.day} {self.satellite} 0 {whole} {part} -1 -1 00000100")

    def ranging(self, seconds, ranging, light):
        """KBR1B rows: (n, 3) of range, rate and acceleration, and of their light-time corrections."""
        for t, r, c in zip((seconds + self.day).tolist(), ranging.tolist(), light.tolist(), strict=True):
            numbers = " ".join(f"{v!r}" for v in (*r, -421420.59, *c, 0.0, 0.0, 0.0))
            self.rows["KBR1B"].append(f"{t} {numbers} 783 769 777 762  00000000")


def netcdf(path, mission, time, variables):
    """One product of a day; variables: {name: (dimensions, values, unit)}; time in GPS seconds past 2000."""
    units = {"units": "seconds since 2000-01-01 12:00:00", "calendar": "standard", "time_scale": "GPS"}
    data = {name: (dims, values, {"units": unit}) for name, (dims, values, unit) in variables.items()}
    attributes = {"product": Path(path).name.split("_")[0], "satellite": mission, "time_scale": "GPS"}
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    xr.Dataset(data, {"time": ("time", time, units)}, attributes).to_netcdf(path)
    return path
