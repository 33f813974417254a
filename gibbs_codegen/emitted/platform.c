#include <float.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

/*
 * For processors with AVX-512, gcc 12 repeats the first entry of a constant where it copies equal
 * entries that zeros follow. So no loop may become such a copy.
 */
#if defined(__GNUC__) && !defined(__clang__) && __GNUC__ == 12 && defined(__x86_64__)
#pragma GCC optimize("no-tree-loop-distribute-patterns")
#endif

#if defined(_MSC_VER) || (defined(__cplusplus) && defined(__GNUC__))
#define RESTRICT __restrict
#elif defined(__cplusplus)
#define RESTRICT
#else
#define RESTRICT restrict
#endif

/* Not every source calls all of these functions. */
#ifdef __GNUC__
#define INLINE inline __attribute__((always_inline, unused))
#else
#define INLINE inline
#endif

/* The lanes or columns of a loop are independent. */
#if defined(__GNUC__) && !defined(__clang__)
#define VECTORISE _Pragma("GCC ivdep")
#else
#define VECTORISE
#endif

/*
 * Compilers use half of the widest registers unless told; a block of states fills the whole. With
 * DISPATCH, what works on blocks is compiled for three generations of processors, among which the
 * program chooses when it starts: by gcc for glibc, without effect elsewhere.
 */
#if defined(DISPATCH) && defined(__x86_64__) && defined(__GLIBC__) && !defined(__clang__) && \
    __GNUC__ >= 12
#define WIDE __attribute__((target_clones("default", "arch=x86-64-v3", "arch=x86-64-v4")))
#elif defined(__clang__) && defined(__AVX512F__)
#define WIDE __attribute__((min_vector_width(512)))
#elif defined(__GNUC__) && __GNUC__ >= 8 && defined(__AVX512F__)
#define WIDE __attribute__((target("prefer-vector-width=512")))
#else
#define WIDE
#endif

#ifdef _OPENMP
#define PARALLEL _Pragma("omp parallel for")
#else
#define PARALLEL
#endif

#include "literals.c"
