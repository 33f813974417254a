"""A robot with an arm on a spring, whose rotors spin and lag, as everything may act on it."""

TEXT = """
name = "blown"

[base]
attitude = "quaternion"
mass     = 1.1
inertia  = [0.012, 0.014, 0.024, 0, 0, 0]

[[link]]
name    = "arm"
xyz     = [0, 0, -0.05]
axis    = "y"
mass    = 0.2
com     = [0, 0, -0.1]
inertia = [1e-3, 1e-3, 2e-5, 0, 0, 0]

[[frame]]
name = "tip"
on   = "arm"
xyz  = [0, 0, -0.2]

[[spring]]
name      = "stay"
frame     = "tip"
to        = "base"
stiffness = 3
length    = 0.1
damping   = 0.02
""" + "".join(
    f"""
[[rotor]]
position              = [{x}, {y}, 0.03]
drag                  = {0.4 * x * y}
spin_inertia          = 4e-5
speed_per_sqrt_thrust = 290
time_constant         = 0.05
"""
    for x in (-0.2, 0.2)
    for y in (-0.2, 0.2)
)
