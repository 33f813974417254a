"""C99: functions, header and constants."""
