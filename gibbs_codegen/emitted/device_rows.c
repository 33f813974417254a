/* The state of a thread. */
static INLINE int state_number(void)
{
    return (int)(blockIdx.x * blockDim.x + threadIdx.x);
}

/* Entries of state i of `count`. */
static INLINE void load(
    const int width, const real *RESTRICT entries, const int count, const int i, real *own)
{
#pragma unroll
    for (int e = 0; e < width; ++e) {
        own[e] = entries[(size_t)e * (size_t)count + (size_t)i];
    }
}

static INLINE void store(
    const int width, const real *own, const int count, const int i, real *RESTRICT entries)
{
#pragma unroll
    for (int e = 0; e < width; ++e) {
        entries[(size_t)e * (size_t)count + (size_t)i] = own[e];
    }
}

/* Entries of state i in a step, if they differ from those of the step before. */
static INLINE void load_rows(
    const Rows *rows, const int width, const int i, const int step, real *own)
{
    if (step && !rows->by_step) {
        return;
    }
    const real *first = rows->entries + i * rows->by_state + step * rows->by_step;
#pragma unroll
    for (int e = 0; e < width; ++e) {
        own[e] = first[e * rows->by_entry];
    }
}
