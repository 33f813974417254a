"""Flights of machines whose numbers are not those of their robot file."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from support.command import run_command

from gibbs_codegen import generate, identify, load, read_robot, read_scenario, simulate

REAL = {"base_mass": 2.3, "forearm_mass": 0.2, "base_inertia_yy": 0.025, "forearm_com_z": -0.09}
