/* Constants of the parameters in p, in `room`, or those of the robot file. */
static const Constants *constants_of(const real *p, Constants *room, int *status)
{
#ifdef PARAMETERS_IN_P
    *status = MODULE(init_constants)(p, room);
    return room;
#else
    (void)p;
    (void)room;
    *status = 0;
    return &MODULE(default_constants);
#endif
}

/* The status. Unless it is zero all results are NaN, since acados does not look at it. */
static int checked(const int status, const int *(*shape)(int), real **res)
{
    for (int k = 0; status && shape(k); ++k) {
        const int *size = shape(k);
        for (int i = 0; res[k] && i < size[0] * size[1]; ++i) {
            res[k][i] = (real)NAN;
        }
    }
    return status;
}
