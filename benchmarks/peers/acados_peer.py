"""The problem of `tracking` in acados, which another interpreter may have."""

from __future__ import annotations

import pickle
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from peers.tracking import Problem

Array = np.ndarray
WORKER = Path(__file__).with_name("acados_worker.py")


class Acados:
    """One real-time iteration an instant, with "our functions" or others."""

    def __init__(self, problem: Problem, interpreter: str, dynamics: str) -> None:
        """Build the solver; raises `RuntimeError` with why none is built."""
        self.problem, self.spent, self.own = problem, 0.0, list[float]()
        self._folder = tempfile.TemporaryDirectory()
        told = Path(self._folder.name, "told")
        with told.open("wb") as errors:
            self._process = subprocess.Popen(
                [interpreter, str(WORKER)],
                cwd=self._folder.name,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
            )
        given = {
            "folder": problem.module.__path__[0],
            "dynamics": dynamics,
            "x": np.r_[problem.hover.q, np.zeros(problem.nv)],
            "u": problem.hover.u,
            **{name: getattr(problem, name) for name in ("h", "nodes", "frame", "references")},
            **{name: getattr(problem, name) for name in ("running", "ending", "limits")},
        }
        try:
            self._told(given)
        except (EOFError, BrokenPipeError):
            last = "".join(told.read_text(errors="replace").splitlines()[-1:])
            raise RuntimeError(f"{interpreter} builds no solver: {last}") from None

    def _told(self, message: object) -> tuple[Array, float, float, int]:
        """The answer to a message."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        pickle.dump(message, self._process.stdin)
        self._process.stdin.flush()
        answer: tuple[Array, float, float, int] = pickle.load(self._process.stdout)  # noqa: S301
        return answer

    def clock(self) -> float:
        """Processor time, s, that it has taken."""
        return self.spent

    def __call__(self, _: float, x: Array) -> Array:
        """Inputs at a time and a state."""
        u, self.spent, own, status = self._told((x, self.problem.references))
        self.own.append(own)
        if status:
            raise ArithmeticError(f"status {status} of acados")
        return u
