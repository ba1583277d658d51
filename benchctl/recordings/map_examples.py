"""The map file explained by example: what `benchctl import --help` prints."""

from __future__ import annotations

from collections.abc import Mapping

MAP_EXAMPLE_CSV = """\
# A table from a LabVIEW program. `benchctl import log.csv --map map.toml -o log.h5`
[unit]
serial = "VG910Q-123"
range_dps = 150                     # rated range; 0: not known

[bench]                             # what is absent is not known
encoder_counts_per_rev = 65536
latitude_deg = 58.5

[file]
delimiter = ";"                     # " ": any run of blanks and tabs
decimal = ","                       # the decimal comma of some countries
header_line = 3                     # the line that holds the names; 0: none, columns are then numbers from 1
first_line = 5                      # the first line of samples

[time]
column = "Time (ms)"                # or, where no column holds it: rate_hz = 1000
unit = "ms"                         # s, ms, us, min; counted from the first sample
stamps = "refuse"                   # "refuse" what is not uniform, "repair" it, or "keep" stamps as they are
gaps = "split"                      # with "repair": "split" into steps at gaps, or "fill" those of 1 or 2 samples

[channels.encoder_deg]
column = "Table"
unit = "counts"                     # deg, rad, arcsec, rev, or counts with counts_per_rev
counts_per_rev = 65536
sign = -1                           # the encoder counts clockwise

[channels.gyro_v]
column = 4
unit = "mV"                         # V, mV, uV; of a digital gyro deg/s, rad/s, deg/h, rpm
scale = 10                          # an attenuator of 10 : 1 before the converter
offset = 0.0                        # V, added last

[channels.gyro_temp_c]
column = "Housing"
unit = "K"                          # degC, K, degF

[channels.supply_v]                 # any other name is kept, with its unit
column = "Supply"
unit = "V"

[[steps]]                           # without any: one step "whole" of kind "motion", known by its encoder
name = "sine at +23"
kind = "sine"                       # static, constant_rate, sine, thermal_ramp, motion
t_start = 0.0                       # s after the first sample; absent: from the first, until the last
t_end = 40.0
amplitude_dps = 100.0
frequency_hz = 0.5
chamber_setpoint_c = 23.0
role = "fit"                        # or "verify": kept aside, no fit sees it
"""

MAP_EXAMPLE_MAT = """\
# A MATLAB file (v5 to v7.3). `benchctl import log.mat --map map.toml -o log.h5`
[unit]
serial = "IMU 2"
range_dps = 250
model = "MPU6050"

[file]
first_row_variable = "data_line"    # the variable that holds the first row to use; or first_line = 510

[time]
column = "all_time"                 # the name of a variable
unit = "s"
stamps = "repair"
gaps = "fill"

[channels.encoder_deg]
column = "data"
index = 3                           # the column of a matrix, from 1
unit = "deg"

[channels.gyro_v]
column = "all_gyro_2_z"
unit = "deg/s"
"""

MAP_EXAMPLE_RECORDS = """\
# An SQLite database (.db, .sqlite) or a JSON document. `benchctl import bench.db --map map.toml -o run7.h5`
[unit]
serial = "IMU 2"

[file]
query = "SELECT t, angle, rate FROM samples WHERE run = 7 ORDER BY t"   # of a database; or its table = "samples"
# table = "run7.data"               # of a JSON document: where in it the rows, or the columns by name, are

[time]
column = "t"
stamps = "repair"

[channels.encoder_deg]
column = "angle"
unit = "rad"

[channels.gyro_v]
column = "rate"
unit = "rad/s"
"""

MAP_EXAMPLE_POINTS = """\
# A table of static points: one row a rate, mean and standard deviation of the output at rest on that rate.
# A CSV with the columns rate_dps, gyro_v_mean (and gyro_v_std, run, temperature_c, duration_s) needs no map.
[unit]
serial = "1"
range_dps = 100
model = "VG910"

[points]
duration_s = 10                     # of every point; absent: not known, or a column of the table
samples = 10000                     # that a mean was taken of

[points.rate]
column = "rate_dps"
unit = "deg/s"

[points.mean]
column = "gyro_v_mean"
unit = "V"

[points.std]
column = "gyro_v_std"
unit = "V"

[points.run]
column = "run"
"""

MAP_EXAMPLE_DRIVE = """\
# A table's drive, for `benchctl diagnose --part drive`: an angle (or velocity_rad_s, or table_rate_dps) and a torque_nm
# (or current_a, or drive_load in any unit, counts for example). A chamber, for `--part chamber`: chamber_temp_c with
# heater_percent (or heater_w, current_a, chamber_setpoint_c) and, where it was measured, ambient_temp_c.
[unit]
serial = "table 1"

[time]
column = "t"

[channels.encoder_deg]
column = "angle"
unit = "rad"

[channels.torque_nm]
column = "torque"
unit = "N m"

[drive]                             # what the lab believes; absent: it is estimated from the recording
inertia_kg_m2 = 0.012
viscous_nm_s = 0.0031
"""

MAP_EXAMPLES: Mapping[str, str] = {
    "a table of samples": MAP_EXAMPLE_CSV,
    "a MATLAB file": MAP_EXAMPLE_MAT,
    "a database, or JSON": MAP_EXAMPLE_RECORDS,
    "a table of static points": MAP_EXAMPLE_POINTS,
    "a table's drive, or a chamber": MAP_EXAMPLE_DRIVE,
}
"""Title -> map file."""
