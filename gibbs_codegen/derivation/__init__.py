"""The Gibbs–Appell equations of a robot, in SymPy, on a tape."""
