"""The benchmark family computed by other tools, behind one interface in C."""
