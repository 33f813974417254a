/* With attitude angles v has the rates of q, and displacements add to it. */
typedef struct {
    const real *q;
} Place;

static void locate(const real *x, Place *at)
{
    at->q = x;
}

/* Rates of q that belong to v. */
static void rates(const Constants *constants, const Place *at, const real *v, real *q_dot)
{
    MODULE(coordinate_rates)(constants, at->q, v, q_dot);
}
