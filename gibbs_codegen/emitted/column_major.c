/* Copies a row-major matrix to a column-major one, unless `to` is null. */
static void store(const int rows, const int columns, const real *from, real *to)
{
    if (to) {
        for (int i = 0; i < rows; ++i) {
            for (int j = 0; j < columns; ++j) {
                to[j * rows + i] = from[i * columns + j];
            }
        }
    }
}
