/* An input of a program: its entries, whether all states share it, what is in it if not given. */
typedef struct {
    int width, is_shared;
    real without;
} Input;

/* Rows that follow each other, one for each state. */
static INLINE Rows rows_of(const real *entries, const size_t width)
{
    Rows rows;
    rows.entries = entries;
    rows.by_state = width;
    rows.by_step = 0;
    return rows;
}

/* Eight rows of eight numbers become columns; `from` and `to` have rows that far apart. */
#if LANES > 1 && (defined(__clang__) || __GNUC__ >= 12)
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

/* The next of the columns of a block that are transposed; the last ones may be so twice. */
static INLINE int next_columns(const int column, const int width)
{
    return column + 8 < width && column + 16 > width ? width - 8 : column + 8;
}
#endif

/*
 * Rows of the states in the lanes of a block become its entries, or all the same.
 * Lanes beyond the `filled` ones have the last state again.
 */
static INLINE void load_rows(
    const Rows rows,
    const real without,
    const size_t first,
    const int filled,
    const size_t step,
    const int width,
    number *block)
{
    const size_t by_state = rows.by_state;
    real *entries = (real *)block;
    int i = 0;
    if (!rows.entries) {
        for (i = 0; i < width * LANES; ++i) {
            entries[i] = without;
        }
        return;
    }
    const real *row = rows.entries + first * by_state + step * rows.by_step;
#ifdef MIX
    const int lanes = filled == LANES && by_state && width >= 8 ? LANES : 0;
    for (int lane = 0; lane < lanes; lane += 8) {
        const real *eight = row + (size_t)lane * by_state;
        for (i = 0; i < width; i = next_columns(i, width)) {
            transpose(eight + i, by_state, entries + i * LANES + lane, LANES);
        }
    }
#endif
    for (; i < width; ++i) {
        for (int lane = 0; lane < LANES; ++lane) {
            const int state = lane < filled ? lane : filled - 1;
            entries[i * LANES + lane] = row[(size_t)state * by_state + (size_t)i];
        }
    }
}

/* Entries of the lanes that are filled become rows, which are so many reals apart, if any. */
static INLINE void store_rows(
    const number *block,
    const int filled,
    const int width,
    const size_t by_state,
    real *rows)
{
    const real *entries = (const real *)block;
    int i = 0;
#ifdef MIX
    const int lanes = rows && filled == LANES && width >= 8 ? LANES : 0;
    for (int lane = 0; lane < lanes; lane += 8) {
        real *eight = rows + (size_t)lane * by_state;
        for (i = 0; i < width; i = next_columns(i, width)) {
            transpose(entries + i * LANES + lane, LANES, eight + i, by_state);
        }
    }
#endif
    for (; rows && i < width; ++i) {
        for (int lane = 0; lane < filled; ++lane) {
            rows[(size_t)lane * by_state + (size_t)i] = entries[i * LANES + lane];
        }
    }
}

/*
 * Refuses a step that makes a number of a state infinite or NaN. It looks at the bits, since with
 * -ffast-math compilers assume that every number is finite.
 */
static INLINE void refuse_infinite(const int width, const number *x, number *refused)
{
    number_bits found = {0};
    for (int i = 0; i < width; ++i) {
        number_bits entry;
        memcpy(&entry, x + i, sizeof entry);
        found |= (number_bits)((entry & MAGNITUDE) >= NOT_FINITE);
    }
    for (int lane = 0; lane < LANES; ++lane) {
        ((real *)refused)[lane] = ((const bits *)&found)[lane] ? R(1.0) : R(0.0);
    }
}
