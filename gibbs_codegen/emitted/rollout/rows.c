/* Rows that follow each other, one for each state. */
static INLINE Rows rows_of(const real *entries, const size_t width)
{
    Rows rows;
    rows.entries = entries;
    rows.by_state = width;
    rows.by_step = 0;
    return rows;
}

/* Rows of the states in the lanes of a block, whose numbers are in `states`, become its entries. */
static INLINE void load_rows(
    const Rows rows,
    const size_t *states,
    const size_t step,
    const int width,
    real *RESTRICT block)
{
    for (int lane = 0; lane < LANES; ++lane) {
        const real *row = rows.entries + states[lane] * rows.by_state + step * rows.by_step;
        for (int i = 0; i < width; ++i) {
            block[i * LANES + lane] = row[i];
        }
    }
}

/* Entries of the lanes that are filled become rows, which are `by_state` reals apart. */
static INLINE void store_rows(
    const real *RESTRICT block,
    const int filled,
    const int width,
    const size_t by_state,
    real *RESTRICT rows)
{
    for (int lane = 0; lane < filled; ++lane) {
        for (int i = 0; i < width; ++i) {
            rows[(size_t)lane * by_state + (size_t)i] = block[i * LANES + lane];
        }
    }
}
