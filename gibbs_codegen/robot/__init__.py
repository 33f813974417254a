"""What a robot is, in plain data and numbers: its file, coordinates, chains and rotors."""
