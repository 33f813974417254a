"""The program that every target prints: straight lines in six kinds of node."""
