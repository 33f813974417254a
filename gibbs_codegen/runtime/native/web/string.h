/* What emitted C needs of <string.h>, as instructions of WebAssembly. */
#pragma once
#include <stddef.h>
#define memcpy __builtin_memcpy
#define memset __builtin_memset
