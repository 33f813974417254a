"""C99: functions, header, constants, and the adapter for CasADi."""
