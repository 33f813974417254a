"""CUDA sources compiled by NVRTC, and called by the driver, through ctypes alone."""

from __future__ import annotations

import ctypes
import re
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.machine.rollout_steps import Parts, rollout_inputs
from gibbs_codegen.runtime.rollouts import (
    REALS,
    Precision,
    Problem,
    Rollout,
    constants_of,
    functions_of,
    given_inputs,
)

Array = NDArray[Any]
# What kernels may be given.
EVERY = Parts(feedback=True, limits=True, lag=True)


@dataclass(frozen=True)
class Resources:
    """What a thread takes: registers, and bytes of stack, of spilled stores and of such loads."""

    registers: int
    stack: int
    stores: int
    loads: int


def nvrtc() -> ctypes.CDLL | None:
    """The compiler's library, where the extra `cuda` is installed."""
    try:
        paths = files("nvidia-cuda-nvrtc") or []
    except PackageNotFoundError:
        return None
    found = [x.locate() for x in paths if re.fullmatch(r"libnvrtc\.so\.\d+", x.name)]
    return ctypes.CDLL(str(found[0])) if found else None


def machine_code(
    folder: Path, architecture: str, *, single: bool = False, flags: Sequence[str] = ()
) -> tuple[bytes, dict[str, Resources]]:
    """Kernels of a generated module for an architecture, as sm_90, and what these take by name.

    Raises `RuntimeError` with what the compiler says.
    """
    rtc, name = nvrtc(), folder.name
    if rtc is None:
        raise RuntimeError("NVRTC is missing: install the extra cuda")
    program = ctypes.c_void_p()
    header, source = ((folder / f"{name}.{end}").read_bytes() for end in ("cuh", "cu"))
    included = (ctypes.c_char_p * 1)(header), (ctypes.c_char_p * 1)(f"{name}.cuh".encode())
    rtc.nvrtcCreateProgram(ctypes.byref(program), source, b"kernels.cu", 1, *included)
    options = [f"--gpu-architecture={architecture}", "--std=c++17", "--ptxas-options=-v", *flags]
    options += [f"-D{name.upper()}_FLOAT"] if single else []
    given = (ctypes.c_char_p * len(options))(*map(str.encode, options))
    failed = rtc.nvrtcCompileProgram(program, len(options), given)
    log = _taken(rtc, program, "ProgramLog").decode()
    if failed:
        raise RuntimeError(f"{folder}: {log[:3000]}")
    code = _taken(rtc, program, "CUBIN")
    rtc.nvrtcDestroyProgram(ctypes.byref(program))
    return code, resources(log)


def _taken(rtc: Any, program: ctypes.c_void_p, what: str) -> bytes:
    """What a program has of a kind."""
    size = ctypes.c_size_t()
    getattr(rtc, f"nvrtcGet{what}Size")(program, ctypes.byref(size))
    room = ctypes.create_string_buffer(size.value)
    getattr(rtc, f"nvrtcGet{what}")(program, room)
    return room.raw[: size.value]


def resources(log: str) -> dict[str, Resources]:
    """Resources by the names of kernels, as the assembler tells them."""
    pattern = (
        r"Compiling entry function '(\w+)'.*?(\d+) bytes stack frame, (\d+) bytes spill stores, "
        r"(\d+) bytes spill loads.*?Used (\d+) registers"
    )
    return {
        found[1]: Resources(*(int(found[k]) for k in (5, 2, 3, 4)))
        for found in re.finditer(pattern, log, re.DOTALL)
    }


class Gpu:
    """The first GPU, by its driver. Raises `RuntimeError` where there is none."""

    def __init__(self, driver: str = "libcuda.so.1", block: int = 128) -> None:
        """Take it by the driver's library, for blocks of so many threads."""
        try:
            self._driver = ctypes.CDLL(driver)
        except OSError:
            raise RuntimeError(f"no GPU: the driver's library {driver} is missing") from None
        device, context = ctypes.c_int(), ctypes.c_void_p()
        self._call("cuInit", 0)
        self._call("cuDeviceGet", ctypes.byref(device), 0)
        self._call("cuDevicePrimaryCtxRetain", ctypes.byref(context), device)
        self._call("cuCtxSetCurrent", context)
        self._device, self.block, self._module = device, block, ctypes.c_void_p()
        name = ctypes.create_string_buffer(100)
        self._call("cuDeviceGetName", name, 100, device)
        self.name = name.value.decode()

    @property
    def architecture(self) -> str:
        """The architecture to compile for."""
        number = ctypes.c_int()
        found = []
        for which in (75, 76):  # CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MAJOR, _MINOR
            self._call("cuDeviceGetAttribute", ctypes.byref(number), which, self._device)
            found.append(number.value)
        return f"sm_{found[0]}{found[1]}"

    def load(self, code: bytes) -> None:
        """Take over kernels, in place of those that it has."""
        self._module = ctypes.c_void_p()
        self._call("cuModuleLoadData", ctypes.byref(self._module), code)

    def send(self, array: Array) -> int:
        """The address of a copy."""
        address = ctypes.c_uint64()
        self._call("cuMemAlloc_v2", ctypes.byref(address), ctypes.c_size_t(max(1, array.nbytes)))
        self.write(address.value, array)
        return address.value

    def write(self, address: int, array: Array) -> None:
        """Put the array where there is room for it."""
        array = np.ascontiguousarray(array)
        whole = ctypes.c_void_p(array.ctypes.data), ctypes.c_size_t(array.nbytes)
        self._call("cuMemcpyHtoD_v2", ctypes.c_uint64(address), *whole)

    def fetch(self, address: int, array: Array) -> Array:
        """The array, filled with what is at an address."""
        whole = ctypes.c_uint64(address), ctypes.c_size_t(array.nbytes)
        self._call("cuMemcpyDtoH_v2", ctypes.c_void_p(array.ctypes.data), *whole)
        return array

    def free(self, address: int) -> None:
        """Give back the room of an array."""
        self._call("cuMemFree_v2", ctypes.c_uint64(address))

    def launch(self, kernel: str, count: int, arguments: Sequence[Any]) -> None:
        """Call a kernel with so many states, and wait for it."""
        function = ctypes.c_void_p()
        self._call("cuModuleGetFunction", ctypes.byref(function), self._module, kernel.encode())
        addresses = (ctypes.c_void_p * len(arguments))(*map(ctypes.addressof, arguments))
        blocks = -(-count // self.block)
        self._call(
            "cuLaunchKernel", function, blocks, 1, 1, self.block, 1, 1, 0, None, addresses, None
        )
        self._call("cuCtxSynchronize")

    def _call(self, name: str, *arguments: Any) -> None:
        if status := self._driver[name](*arguments):
            words = ctypes.c_char_p()
            self._driver.cuGetErrorString(status, ctypes.byref(words))
            raise RuntimeError(f"{name}: {(words.value or b'').decode() or f'error {status}'}")


class Rows(ctypes.Structure):
    """As <name>_rollout_rows."""

    _fields_ = (
        ("entries", ctypes.c_void_p),
        *((name, ctypes.c_longlong) for name in ("by_entry", "by_state", "by_step")),
    )


class States(ctypes.Structure):
    """As <name>_rollout_states."""

    _fields_ = (
        *((name, ctypes.c_void_p) for name in ("x", "steps", "ended", "samples")),
        ("every", ctypes.c_int),
    )


def of_states(values: Array, real: Any) -> Array:
    """Rows of states (n, ...) as columns (entries, n)."""
    return np.ascontiguousarray(values.reshape(len(values), -1).T, real)


class Kernels:
    """Kernels of a module on a device, in a precision."""

    def __init__(self, device: Gpu, module: Any, precision: Precision = "double") -> None:
        self._device, self._module, self.precision = device, module, precision
        self._real = REALS[precision]
        self._number = np.ctypeslib.as_ctypes_type(self._real)

    def function(self, name: str, constants: Any, *arguments: Array) -> list[Array]:
        """Results (n, ...) of a function for arguments (n, ...); constants (1 or n, k)."""
        signature = functions_of(self._module).signatures[name]
        count = len(arguments[0])
        ending, given = self._constants(constants)
        sent = [self._device.send(of_states(x, self._real)) for x in arguments]
        made = [np.zeros((int(np.prod(shape)), count), self._real) for shape in signature.shapes]
        results = [self._device.send(x) for x in made]
        addresses = [ctypes.c_void_p(x) for x in (*sent, *results)]
        kernel = f"{self._module.NAME}_{name}_batch{ending}"
        self._device.launch(kernel, count, [given, ctypes.c_int(count), *addresses])
        fetched = [self._device.fetch(at, x) for at, x in zip(results, made, strict=True)]
        return [
            x.T.reshape(count, *shape) for x, shape in zip(fetched, signature.shapes, strict=True)
        ]

    def constants(self, parameters: Array) -> tuple[Array, Array]:
        """Constants (n, k) of parameters (n, m), and whether those of each are of no use."""
        count, name = len(parameters), self._module.NAME
        size = len(np.frombuffer(self._module.prepare({})))
        made, useless = np.zeros((size, count), self._real), np.zeros(count, np.int32)
        sent = [self._device.send(x) for x in (of_states(parameters, self._real), made, useless)]
        arguments = [ctypes.c_int(count), *map(ctypes.c_void_p, sent)]
        self._device.launch(f"{name}_init_constants_batch", count, arguments)
        return self._device.fetch(sent[1], made).T, self._device.fetch(sent[2], useless)

    def rollout(self, problem: Problem) -> Rollout:
        """The rollout of a problem, as `compiled_rollout`; with a law or limits it needs all."""
        call = self.prepared(problem)
        call.run()
        return call.rollout()

    def prepared(self, problem: Problem) -> Call:
        """The rollout of a problem, whose arrays are on the device."""
        return Call(
            self._device, self._real, self._number, problem, *self._constants(constants_of(problem))
        )

    def _constants(self, constants: Array) -> tuple[str, Any]:
        """The ending of the kernel's name, and its argument for constants (1 or n, k)."""
        numbers = np.atleast_2d(constants).astype(self._real)
        if len(numbers) > 1:
            return "_each", ctypes.c_void_p(self._device.send(of_states(numbers, self._real)))
        array = self._number * numbers.size
        structure = type("Constants", (ctypes.Structure,), {"_fields_": [("all", array)]})
        return "", structure(array(*numbers[0]))


class Call:
    """A rollout whose arrays are on a device."""

    def __init__(
        self, device: Gpu, real: Any, number: Any, problem: Problem, ending: str, constants: Any
    ) -> None:
        self._device, self._problem = device, problem
        robot, parts = functions_of(problem.module), problem.parts
        self.count, self._begin = len(problem.q), problem.begin(parts)
        values = given_inputs(problem, parts, np)
        lagging = robot.lagging if len(self._begin) < 3 else 0
        begin = np.concatenate([*self._begin, np.zeros((self.count, lagging))], axis=1)
        kept = problem.steps // problem.every
        self._x = of_states(begin, real)
        self._samples = np.zeros((kept, *self._x.shape), real)
        self._steps, self._ended = np.zeros(self.count, np.int32), np.zeros(self.count, np.uint8)
        arrays = self._x, self._steps, self._ended, self._samples
        self._sent: list[int] = []
        self._addresses = [self._send(x) for x in arrays]
        states = States(*self._addresses, problem.every)
        fields, given = [], []
        folder, name = Path(problem.module.__path__[0]), problem.module.NAME
        source = (folder / f"{name}.cu").read_text(encoding="utf-8")
        every = rollout_inputs(robot, EVERY)
        for name, x in every.items():
            kind: Any = number * x.size if x.is_uniform else Rows
            if is_large := f"const real *{name};" in source:
                kind = ctypes.c_void_p
            fields.append((name, kind))
            if name not in values:
                given.append(kind())
            elif is_large:
                given.append(kind(self._send(np.asarray(values[name], real))))
            elif x.is_uniform:
                given.append(kind(*np.asarray(values[name], real).ravel()))
            else:
                given.append(self._rows(values[name], real))
        structure = type("Given", (ctypes.Structure,), {"_fields_": fields})
        word = "commands" if problem.feedback is not None else "inputs"
        self.kernel = f"{problem.module.NAME}_rollout_{problem.method}_{word}{ending}"
        numbers = ctypes.c_int(self.count), ctypes.c_int(problem.steps), number(problem.dt)
        self._arguments = [constants, structure(*given), states, *numbers]

    def _send(self, array: Array) -> int:
        """The address of a copy, of which `free` gives back the room."""
        self._sent.append(self._device.send(array))
        return self._sent[-1]

    def free(self) -> None:
        """Give back the room of all arrays."""
        for address in self._sent:
            self._device.free(address)

    def restart(self) -> None:
        """Put the states back to where they began."""
        arrays = self._x, self._steps, self._ended
        for address, array in zip(self._addresses, arrays, strict=False):
            self._device.write(address, array)

    def run(self) -> None:
        """Take all steps."""
        self._device.launch(self.kernel, self.count, self._arguments)

    def rollout(self) -> Rollout:
        """What it has come to."""
        fetched = map(np.empty_like, (self._x, self._steps, self._ended, self._samples))
        x, taken, ended, samples = map(self._device.fetch, self._addresses, fetched)
        begin = np.concatenate(self._begin, axis=1)
        every = np.moveaxis(samples, 2, 0)[..., : begin.shape[1]]
        every = np.concatenate([begin[:, None].astype(x.dtype), every], axis=1)
        ends = np.cumsum([part.shape[1] for part in self._begin])
        parts = np.split(every, ends[:-1], axis=2)
        return self._problem.rollout(parts, taken.astype(np.int64), ended.view(np.int8))

    def _rows(self, values: Array, real: Any) -> Rows:
        """Rows (1 or n, 1 or steps, ...), on the device entry by entry in each step."""
        states, steps, *_ = values.shape
        columns = values.reshape(states, steps, -1).transpose(1, 2, 0)
        address = self._send(np.ascontiguousarray(columns, real))
        distances = [states, int(states > 1), columns[0].size if steps > 1 else 0]
        return Rows(address, *distances)
