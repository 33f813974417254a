/* Copies the entries of a row-major matrix at `count` indices. */
static void gather(const int count, const int *rows, const int *columns, const int width,
                   const real *matrix, real *entries)
{
    for (int i = 0; i < count; ++i) {
        entries[i] = matrix[rows[i] * width + columns[i]];
    }
}
