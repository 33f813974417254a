/* Literals and the layout of their bits; functions of <math.h>. */
#ifdef SINGLE
#define R(literal) literal##f
#define LIBRARY(function) function##f
typedef uint32_t bits;
#define MAGNITUDE UINT32_C(0x7fffffff)
#define NOT_FINITE UINT32_C(0x7f800000)
#else
#if DBL_MANT_DIG != 53
#error "double has not 64 bits here: choose single precision, as the header says"
#endif
/* This does not compile with -fsingle-precision-constant, which makes floats of all constants. */
typedef char constants_are_double[(long)16777217.0 == 16777217L ? 1 : -1];
#define R(literal) literal
#define LIBRARY(function) function
typedef uint64_t bits;
#define MAGNITUDE UINT64_C(0x7fffffffffffffff)
#define NOT_FINITE UINT64_C(0x7ff0000000000000)
#endif
