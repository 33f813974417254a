"""Pictures of robots: of their structure, their chains, and the drawings of pages."""
