"""Pictures of robots: of their structure, their chains, and the drawings of pages."""

# Formats of files, the one by default first.
FORMATS = ("png", "pdf", "svg")
