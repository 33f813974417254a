"""A flight as one page that plays without a server."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from gibbs_codegen.figures.robot_drawing import samples_at
from gibbs_codegen.simulator.record.flight import Flight
from gibbs_codegen.viewer.flight_scene import FlightScene, known_samples
from gibbs_codegen.viewer.page import ViewPage, that_fits, view_page
from gibbs_codegen.viewer.server import empty_server

# Frames per second, and frames at most, while there is room.
_RATE, _MOST = 25.0, 1000


def flight_page(flight: Flight) -> ViewPage:
    """Record a flight, with as many frames as there is room for in less than 2 MB.

    Raises `UsageError` if viser is not installed, or the robot is nowhere at any time.
    """
    known = known_samples(flight)
    start, end = flight.time[known[[0, -1]]]

    def recorded(frames: int) -> ViewPage:
        samples = {*samples_at(flight, np.linspace(start, end, frames))}
        return _recorded(flight, sorted(samples.intersection(known.tolist())))

    return that_fits(recorded, min(int((end - start) * _RATE) + 1, _MOST))


def _recorded(flight: Flight, samples: list[int]) -> ViewPage:
    """The page that shows some samples."""
    with empty_server() as server:
        scene = FlightScene(server, flight, frames=0)
        scene.show(samples[0])
        recording = server.get_scene_serializer()
        for before, sample in pairwise(samples):
            recording.insert_sleep(float(flight.time[sample] - flight.time[before]))
            scene.show(sample)
        client = recording.as_html()
    return view_page(client, f"{flight.robot}, {flight.scenario}", scene.key())
