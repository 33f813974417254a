"""Languages that a program is printed in."""
