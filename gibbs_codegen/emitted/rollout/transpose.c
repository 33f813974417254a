/* Eight rows of eight numbers become columns; `from` and `to` have rows that far apart. */
#if defined(__clang__) || (defined(__GNUC__) && __GNUC__ >= 12)
#define MIX __builtin_shufflevector
typedef real Eight
    __attribute__((vector_size(8 * sizeof(real)), aligned(sizeof(real)), may_alias));

static INLINE void transpose(
    const real *from,
    const size_t from_step,
    real *to,
    const size_t to_step)
{
    Eight row[8], pair[8], four[8];
    for (size_t i = 0; i < 8; ++i) {
        row[i] = *(const Eight *)(from + i * from_step);
    }
    for (size_t i = 0; i < 8; i += 2) {
        pair[i] = MIX(row[i], row[i + 1], 0, 8, 2, 10, 4, 12, 6, 14);
        pair[i + 1] = MIX(row[i], row[i + 1], 1, 9, 3, 11, 5, 13, 7, 15);
    }
    for (size_t k = 0; k < 4; ++k) {
        const size_t i = k + k / 2 * 2;
        four[i] = MIX(pair[i], pair[i + 2], 0, 1, 8, 9, 4, 5, 12, 13);
        four[i + 2] = MIX(pair[i], pair[i + 2], 2, 3, 10, 11, 6, 7, 14, 15);
    }
    for (size_t i = 0; i < 4; ++i) {
        const Eight low = MIX(four[i], four[i + 4], 0, 1, 2, 3, 8, 9, 10, 11);
        const Eight high = MIX(four[i], four[i + 4], 4, 5, 6, 7, 12, 13, 14, 15);
        *(Eight *)(to + i * to_step) = low;
        *(Eight *)(to + (i + 4) * to_step) = high;
    }
}
#else
static INLINE void transpose(
    const real *from,
    const size_t from_step,
    real *to,
    const size_t to_step)
{
    for (size_t i = 0; i < 8; ++i) {
        for (size_t j = 0; j < 8; ++j) {
            to[j * to_step + i] = from[i * from_step + j];
        }
    }
}
#endif
