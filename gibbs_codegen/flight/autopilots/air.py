"""The place of the world's origin on the earth, and the standard atmosphere above it."""

from __future__ import annotations

import math

from gibbs_codegen.flight.plant.vehicle import Array

# The origin of the world, where PX4 takes its simulators to be: degrees, and m above the sea.
LATITUDE, LONGITUDE, ALTITUDE = 47.397742, 8.545594, 488.0
_EARTH = 6378137.0


def place_at(position: Array) -> tuple[float, float, float]:
    """Latitude and longitude, degrees, and altitude above the sea, m, of a place (3) in NED, m."""
    north, east, down = position.tolist()
    around = _EARTH * math.cos(math.radians(LATITUDE))
    latitude, longitude = (math.degrees(x) for x in (north / _EARTH, east / around))
    return LATITUDE + latitude, LONGITUDE + longitude, ALTITUDE - down


def temperature_at(altitude: float) -> float:
    """Temperature, °C, of the standard atmosphere at an altitude, m."""
    return 15.0 - 0.0065 * altitude


def pressure_at(altitude: float) -> float:
    """Pressure, hPa, of the standard atmosphere at an altitude, m."""
    # None is left where its temperature would be absolute zero.
    return 1013.25 * max(1.0 - 0.0065 * altitude / 288.15, 0.0) ** 5.25588
