"""The record of a flight: its time series."""
