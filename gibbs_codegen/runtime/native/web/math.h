/*
 * What emitted C needs of <math.h> without a C library: what WebAssembly has as instructions, and
 * five functions that it is given. Sine and cosine are called for angles beyond 1e5 rad alone.
 */
#pragma once
#define sqrt __builtin_sqrt
#define fabs __builtin_fabs
#define copysign __builtin_copysign
#define NAN __builtin_nan("")
#define INFINITY __builtin_inf()
#define GIVEN(name) __attribute__((import_module("env"), import_name(#name))) double name
GIVEN(sin)(double);
GIVEN(cos)(double);
GIVEN(atan)(double);
GIVEN(atan2)(double, double);
GIVEN(exp)(double);
