"""What moves, as array programs: machines of parts, laws over them, and the steps they take."""
