"""Which random trees stand for all of them."""

# One with Tait–Bryan angles and one with a quaternion, which together have held and welded links,
# rotors on links, springs, poses and Denavit–Hartenberg parameters.
QUICK_TREES = ((9, "tait_bryan"), (429, "quaternion"))
