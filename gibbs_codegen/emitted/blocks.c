/* Copies a block; its last filled lane is repeated in the unused ones. */
static INLINE void fill_lanes(const size_t width, const size_t filled, const real *RESTRICT block,
    real *RESTRICT whole_block)
{
    for (size_t i = 0; i < width; ++i) {
        for (size_t lane = 0; lane < LANES; ++lane) {
            whole_block[i * LANES + lane] = block[i * LANES + (lane < filled ? lane : filled - 1)];
        }
    }
}

/* Packs rows of states into blocks; copies of the last state fill the last block. */
static INLINE void pack_rows(const size_t count, const size_t width, const real *RESTRICT rows,
    real *RESTRICT blocks)
{
    for (size_t first = 0; first < count; first += LANES) {
        const size_t filled = count - first < LANES ? count - first : LANES;
        for (size_t i = 0; i < width; ++i) {
            for (size_t lane = 0; lane < LANES; ++lane) {
                const size_t state = first + (lane < filled ? lane : filled - 1);
                blocks[first * width + i * LANES + lane] = rows[state * width + i];
            }
        }
    }
}

/* Unpacks blocks into rows of states. */
static INLINE void unpack_rows(const size_t count, const size_t width,
    const real *RESTRICT blocks, real *RESTRICT rows)
{
    for (size_t state = 0; state < count; ++state) {
        const size_t lane = state % LANES;
        for (size_t i = 0; i < width; ++i) {
            rows[state * width + i] = blocks[(state - lane) * width + i * LANES + lane];
        }
    }
}
