"""Control laws: the inputs that are commanded at a time and in a state."""
