"""A small autopilot in Python on pymavlink: the independent other end of the tests and of the closed loop.

A fixed wing flies a plan by the position that it is given: by its own GPS receiver until that is denied or spoofed, and
by GPS_INPUT, judged as ArduPilot judges it. tests/support/autopilot.py is the program; docs/closed-loop.md says how it
is used and what it leaves out. Angles are radians, lengths metres, times seconds unless a name says otherwise.
"""
