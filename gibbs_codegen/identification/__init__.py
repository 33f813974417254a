"""Numbers of robot files from logs: what is free, what was recorded, and what explains it best."""
