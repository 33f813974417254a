"""The machine that flies: its functions, actuators, and what its rotors can do."""
