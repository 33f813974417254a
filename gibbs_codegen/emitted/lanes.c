/* An array of a program: of each entry LANES numbers, or one where all states share it. */
typedef struct {
    const real *entries;
    int lanes;
} Given;

static INLINE Given shared(const real *entries)
{
    const Given found = {entries, 1};
    return found;
}

static INLINE Given of_each(const number *entries)
{
    const Given found = {(const real *)entries, LANES};
    return found;
}

/* An entry in all lanes. */
static INLINE number of_all(const Given array, const int i)
{
    if (array.lanes > 1) {
        return ((const number *)(const void *)array.entries)[i];
    }
    return same(array.entries[i]);
}

static INLINE void take_lane(const Given array, const int count, const int lane, real *found)
{
    for (int i = 0; i < count; ++i) {
        found[i] = array.entries[i * array.lanes + (array.lanes > 1 ? lane : 0)];
    }
}

static INLINE void put_lane(const int count, const int lane, const real *values, number *array)
{
    for (int i = 0; i < count; ++i) {
        ((real *)array)[i * LANES + lane] = values[i];
    }
}

/* Searching is rare; what is inlined makes the rest slower. */
#ifdef __GNUC__
#define APART __attribute__((noinline))
#else
#define APART
#endif
