"""Flights under autopilots that run as programs of their own, in step with the flight.

`machine` is the robot as an autopilot has it: outputs in, readings of sensors out. `px4`,
`ardupilot` and `betaflight` are links to autopilots, and `session` has the loop of a flight.
"""
