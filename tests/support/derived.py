"""Models of robots, which are derived once for all runs until the generator changes.

For tests of what is made of a model. Those of the derivation itself, or that change a part of the
generator first, call `derive`.
"""

from __future__ import annotations

import pickle

from gibbs_codegen.derivation.derive import derive
from gibbs_codegen.program.choice import Derivatives, Functions, chosen_functions
from gibbs_codegen.program.model import Model, Progress
from gibbs_codegen.robot.model import Robot
from support.kept import kept_folder, made_once


def derived(
    robot: Robot,
    keep_zeros: bool = False,
    progress: Progress = lambda _: None,
    derivatives: Derivatives = False,
    functions: Functions = None,
) -> Model:
    """What `derive` makes of the same arguments."""
    chosen = chosen_functions(functions, derivatives)
    folder = kept_folder(robot, keep_zeros, chosen)
    file = folder / "model.pickle"

    def make() -> None:
        folder.mkdir()
        file.write_bytes(pickle.dumps(derive(robot, keep_zeros, progress, derivatives, functions)))

    made_once(folder, make)
    model: Model = pickle.loads(file.read_bytes())  # noqa: S301
    return model
