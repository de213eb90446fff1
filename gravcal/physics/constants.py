"""Numbers of nature and of convention: name = value, then unit and source."""

# Earth's gravity
GM = 3.986004415e14  # m3 s-2, EGM2008 (TT-compatible), the value of the GRACE and GRACE-FO standards
EARTH_RADIUS = 6378136.3  # m, reference radius of EGM2008
J2 = 1.0826359e-3  # 1, EGM2008 zero-tide: -sqrt(5) C20 with C20 = -4.8416948e-4

# Earth's shape and rotation
EARTH_ROTATION_RATE = 7.292115146706979e-5  # rad s-1, d(ERA)/d(UT1), IERS Conventions 2010, eq. 5.15

# Geomagnetic reference field
IGRF_RADIUS = 6371200.0  # m, reference radius of the IGRF (Alken et al. 2021, Earth Planets Space 73:49)

# Electromagnetism
SPEED_OF_LIGHT = 299792458.0  # m s-1, exact (SI)

# Time
GPS_EPOCH_JD = 2451545.0  # d, Julian date in GPS time of 2000-01-01 12:00:00, origin of GRACE time tags (JPL D-22027)
GPS_EPOCH_MJD = 51544.5  # d, the same as modified Julian date
TAI_MINUS_GPS = 19.0  # s, exact (IS-GPS-200)
TT_MINUS_TAI = 32.184  # s, exact (IAU 1991)
TT_MINUS_GPS = TAI_MINUS_GPS + TT_MINUS_TAI  # s
DAY = 86400.0  # s
ARCSECOND = 4.84813681109536e-6  # rad, pi / 648000
