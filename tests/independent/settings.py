"""All keyword arguments of `make_event`, with their defaults."""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Settings:
    """What is simulated. Units are in the names or beside them; vectors are SRF."""

    satellite: str = "C"
    date: str = "2020-02-01"
    offset_um: tuple = (107.0, 4.0, 13.0)  # proof mass -> centre of mass
    manoeuvres: list | None = None  # None: the seven; else (kind, area) pairs or mappings of plan.Manoeuvre fields
    amplitude_ma: float = 110.0
    window_s: tuple = (300.0, 300.0)  # quiet time before and after each manoeuvre
    whole_day: bool = False
    effects: dict = field(default_factory=dict)  # see catalogue.EFFECTS
    noise_scale: float = 1.0  # of all instruments; 0 leaves quantisation and tag rounding
    noise_change: float = 0.0  # spread of the logarithm of its amplitude from window to window, of each instrument
    quantise: bool = True
    start_fraction: float | None = None  # of the second in which each wave starts; None: random for each
    torque_scale: float = 1.0  # of the aerodynamic torque
    force_scale: float = 1.0  # of the non-gravitational acceleration
    inertia: tuple = (110.49, 580.67, 649.69)  # kg m2
    dipole_per_current: float = 0.25  # A m2 / mA
    control: str = "off"  # control currents during a manoeuvre: "off", "hold" or "on"
    control_phase_s: float = 0.0  # control currents change this long after each MAG tag
    control_dither_ma: float = 0.1
    pointing_error_rad: float = 1e-3
    rate_error_rad_s: float = 1e-6
    leads: bool | None = None  # flies with -x along the velocity; None: C leads
    sca_noise_rad: float | tuple = 3e-6
    sca_flips: int = 0  # number of sign changes of the quaternion along the day
    mag_noise_nt: float = 5.0
    mag_bias_nt: tuple | None = None  # None: 500 to 1000 nT, random signs
    clock_offset_s: float = 0.1  # GPS - receiver time at midnight
    clock_drift: float = -1.5e-8
    field_generation: int = 13  # of IGRF
    height_m: float = 490e3
    inclination_deg: float = 89.0
    eccentricity: float = 0.0015
    session_margin_s: float = 120.0  # least time between two windows
    truth_file: str | None = None  # JSON, outside the folder
    keep_scenes: bool = False  # leave the simulated states in the truth
