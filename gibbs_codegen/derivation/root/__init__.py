"""How the base moves: attitude and position, behind one protocol."""
