"""Moving machines as array programs: their parts, laws over them, and the steps they take."""
