"""The closed loop in time: its derivative, in Python and in C, and what integrates it."""
