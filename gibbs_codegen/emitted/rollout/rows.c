/* Rows that follow each other, one for each state. */
static INLINE Rows rows_of(const real *entries, const size_t width)
{
    Rows rows;
    rows.entries = entries;
    rows.by_state = width;
    rows.by_step = 0;
    return rows;
}

/* The next of the columns of a row that are transposed; the last ones may be so twice. */
static INLINE int next_columns(const int column, const int width)
{
    return column + 8 < width && column + 16 > width ? width - 8 : column + 8;
}

/*
 * Rows of the states in the lanes of a block become its entries, or zeros where there are none.
 * Lanes beyond the `filled` ones have the last state again.
 */
static INLINE void load_rows(
    const Rows rows,
    const size_t first,
    const int filled,
    const size_t step,
    const int width,
    real *block)
{
    const real *row = rows.entries;
    if (!row) {
        memset(block, 0, (size_t)(width * LANES) * sizeof *block);
        return;
    }
    row += first * rows.by_state + step * rows.by_step;
    if (rows.by_state == 0) {
        for (int i = 0; i < width; ++i) {
            for (int lane = 0; lane < LANES; ++lane) {
                block[i * LANES + lane] = row[i];
            }
        }
    } else if (filled == LANES && width >= 8) {
        for (int lane = 0; lane < LANES; lane += 8) {
            const real *eight = row + (size_t)lane * rows.by_state;
            for (int i = 0; i < width; i = next_columns(i, width)) {
                transpose(eight + i, rows.by_state, block + i * LANES + lane, LANES);
            }
        }
    } else {
        for (int lane = 0; lane < LANES; ++lane) {
            const int state = lane < filled ? lane : filled - 1;
            for (int i = 0; i < width; ++i) {
                block[i * LANES + lane] = row[(size_t)state * rows.by_state + (size_t)i];
            }
        }
    }
}

/* Entries of the lanes that are filled become rows, which are `by_state` reals apart. */
static INLINE void store_rows(
    const real *block,
    const int filled,
    const int width,
    const size_t by_state,
    real *rows)
{
    if (filled == LANES && width >= 8) {
        for (int lane = 0; lane < LANES; lane += 8) {
            real *eight = rows + (size_t)lane * by_state;
            for (int i = 0; i < width; i = next_columns(i, width)) {
                transpose(block + i * LANES + lane, LANES, eight + i, by_state);
            }
        }
    } else {
        for (int lane = 0; lane < filled; ++lane) {
            for (int i = 0; i < width; ++i) {
                rows[(size_t)lane * by_state + (size_t)i] = block[i * LANES + lane];
            }
        }
    }
}
