"""What is kept of a flight: its time series."""
