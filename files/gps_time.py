"""GPS time, which counts weeks and seconds of the week since 6 January 1980 and has no leap seconds."""

GPS_EPOCH_S = 315_964_800.0  # 6 January 1980 since 1970
WEEK_S = 604_800.0
LEAP_S = 18.0  # GPS ahead of UTC since 2017
