"""The text of `python -m d2d.radar --help`."""

PROGRAM = "python -m d2d.radar"

HELP = f"""\
Estimates how a vehicle moved from the measurements of its Doppler radars.

A first try, with a simulated log that the program writes itself:

  {PROGRAM} example log.csv
  {PROGRAM} track --csv log.csv --mounting radar 0.4 0 0 --output drive

Help on each command: {PROGRAM} track --help
"""

TRACK_HELP = """\
Estimates the velocity of a vehicle from one radar or several, integrates it to a path, and writes

  PREFIX.tum              the path, a line "t x y z qx qy qz qw" per pose, for evo and others
  PREFIX_velocities.txt   v_x, v_y, omega and their covariances; its header names the columns
  PREFIX.npz              everything, for d2d.radar.Track.load
  PREFIX.png              a picture (if matplotlib is installed)

Either all of them are written at the end or none. The first run compiles for up to a minute.
"""

TRACK_EPILOG = f"""\
A CSV file has a line for each target and a first line that names the columns:

  time,sensor,range,azimuth,doppler,sigma_range,sigma_azimuth,sigma_doppler
  12.05,front,14.21,-0.31,-8.92,0.15,0.009,0.06

  time            s; lines with equal time and sensor are one scan
  sensor          a name; without this column there is one sensor, called "radar"
  range           m
  azimuth         rad (with --degrees: degrees), 0 along the boresight, counter-clockwise positive
  doppler         m/s, positive if the target moves away: ahead of a moving car it is negative
  sigma_...       standard deviations in the same units; or --sigma-range and so on for all targets

Columns may come in any order; others are ignored. If in doubt, use the standard deviations of the
sensor's data sheet. If the sensor rounds its values to steps, add the variance step^2 / 12.

Where a sensor sits: x forward and y left of the vehicle's origin (best the middle of the rear axle)
in m, and the direction of its boresight in degrees, counter-clockwise from straight ahead.

examples:
  one radar at the front bumper, standard deviations for all targets:
    {PROGRAM} track --csv log.csv --degrees --mounting radar 3.7 0 0 \\
        --sigma-range 0.15 --sigma-azimuth 0.5 --sigma-doppler 0.06

  two corner radars together, each scan with the one 0.3 s before, errors that targets share:
    {PROGRAM} track --csv log.csv --mounting left 3.6 0.8 45 --mounting right 3.6 -0.8 -45 \\
        --horizon 0.3 --budget-azimuth 0.2 --budget-doppler 0.04 --output results/drive

  a single side radar of a car that does not slip sideways:
    {PROGRAM} track --csv log.csv --mounting left 3.6 0.8 90 --side-slip 0.05

  data sets in their own layout:
    {PROGRAM} track --radarscenes RadarScenes --sequence 105 --sensor 1 2 3 4
    {PROGRAM} track --nuscenes nuscenes --scene scene-0061 --channel RADAR_FRONT RADAR_FRONT_LEFT

What is printed at the end says how many estimates were accepted, and why the others were not:

  a scan without targets          nothing to estimate; the path continues with the last velocity
  a scan that repeats an ...      the sensor froze, or its message was delivered twice
  no optimum near the start       too few targets are seen in both scans: more sensors
  an optimum that rejects ...     scans do not fit each other: too small standard deviations, a
                                  wrong mounting, azimuths of the wrong sign
  an optimum that rests on ...    too few targets agree: --side-slip, more sensors
  a yaw rate with a sigma of ...  the targets tell too little: --horizon 0.3, --side-slip
  a turn of ... between scans     times in another unit than s, or a much too long --horizon
  a side slip, an acceleration,   no vehicle moves like that: a wrong optimum, or a wrong mounting
  a speed or a yaw rate of ...    if it is most of them

If the path runs backwards, the sign of the Doppler velocities or the yaw of a mounting is wrong; if
it bends the wrong way, the sign of the azimuths. The book's pages "Your own radar" and "When a path
looks wrong" explain how to choose standard deviations and a budget, and how to test a
covariance.
"""
