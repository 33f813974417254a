"""A driver of CUDA that is the CPU: kernels compiled by g++, whose threads it calls one by one."""

from __future__ import annotations

import re
from pathlib import Path

from benchmarks.cuda_device import Gpu
from support.tools import compiled, tool

_DRIVER = """\
#include <dlfcn.h>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <string>
using Call = void (*)(unsigned, unsigned, unsigned, void **);
extern "C" {
int cuInit(unsigned) { return 0; }
int cuDeviceGet(int *device, int) { *device = 0; return 0; }
int cuDevicePrimaryCtxRetain(void **context, int) { *context = nullptr; return 0; }
int cuCtxSetCurrent(void *) { return 0; }
int cuCtxSynchronize() { return 0; }
int cuDeviceGetName(char *name, int size, int) { std::strncpy(name, "CPU", size); return 0; }
int cuDeviceGetAttribute(int *value, int which, int) { *value = which == 75 ? 9 : 0; return 0; }
int cuGetErrorString(int, const char **words) { *words = "not found"; return 0; }
int cuModuleLoadData(void **module, const char *path)
{
    *module = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    return *module ? 0 : 200;
}
int cuModuleGetFunction(void **function, void *module, const char *name)
{
    *function = dlsym(module, ("call_" + std::string(name)).c_str());
    return *function ? 0 : 500;
}
int cuMemAlloc_v2(uint64_t *address, size_t size)
{
    *address = (uint64_t)std::malloc(size);
    return 0;
}
int cuMemFree_v2(uint64_t address) { std::free((void *)address); return 0; }
int cuMemcpyHtoD_v2(uint64_t to, const void *from, size_t size)
{
    std::memcpy((void *)to, from, size);
    return 0;
}
int cuMemcpyDtoH_v2(void *to, uint64_t from, size_t size)
{
    std::memcpy(to, (void *)from, size);
    return 0;
}
int cuLaunchKernel(Call call, unsigned blocks, unsigned, unsigned, unsigned threads, unsigned,
    unsigned, unsigned, void *, void **arguments, void **)
{
    for (unsigned block = 0; block < blocks; ++block) {
        for (unsigned thread = 0; thread < threads; ++thread) {
            call(block, thread, threads, arguments);
        }
    }
    return 0;
}
}
"""
# A kernel is a function of one thread, which is called with the addresses of its arguments.
_KERNELS = """\
#define __device__
#define __global__
#define __forceinline__ inline
#include <cstddef>
#include <utility>
static struct {{ unsigned x; }} blockIdx, blockDim, threadIdx;
#include "{name}.cu"
template <class... Given, std::size_t... Places>
static void called(void (*kernel)(Given...), void **given, std::index_sequence<Places...>)
{{
    kernel(*static_cast<Given *>(given[Places])...);
}}
template <class... Given>
static void called(void (*kernel)(Given...), void **given)
{{
    called(kernel, given, std::index_sequence_for<Given...>());
}}
#define KERNEL(name) \\
    extern "C" void call_##name(unsigned block, unsigned thread, unsigned size, void **given); \\
    extern "C" void call_##name(unsigned block, unsigned thread, unsigned size, void **given) \\
    {{ \\
        blockIdx.x = block, threadIdx.x = thread, blockDim.x = size; \\
        called(name, given); \\
    }}
"""
FLAGS = ["-std=c++17", "-O0", "-Wall", "-Wextra", "-Werror", "-Wno-unknown-pragmas"]
FLAGS += ["-ffp-contract=off", "-shared", "-fPIC"]


def cuda_on_cpu(folder: Path) -> Gpu:
    """The CPU as a GPU; `folder` is where its driver is put."""
    driver = _library(folder / "driver.cpp", _DRIVER, folder / "driver.so", ["-ldl"])
    return Gpu(str(driver), block=3)


def code_for_cpu(folder: Path, *, single: bool) -> bytes:
    """What such a driver takes for the machine code of a generated module."""
    name = folder.name
    text = (folder / f"{name}.cu").read_text()
    kernels = re.findall(r"__global__ void (\w+)\(", text)
    text = _KERNELS.format(name=name) + "".join(f"KERNEL({x})\n" for x in kernels)
    flags = [f"-D{name.upper()}_FLOAT"] if single else []
    return bytes(_library(folder / "kernels.cpp", text, folder / f"kernels_{single}.so", flags))


def _library(source: Path, text: str, output: Path, flags: list[str]) -> Path:
    """A library of a text, unless it is there, where it may be in use."""
    source.write_text(text)
    return output if output.exists() else compiled([tool("g++"), *FLAGS, source, *flags], output)
