/* The semi-implicit Euler method: the new velocities move the coordinates. */
static INLINE void euler(const real h, Block *b)
{
    accelerate(b->constants, b->q, b->v, b->begin, b->wrenches, b->acceleration[0]);
    VECTORISE
    for (int e = 0; e < NV * LANES; ++e) {
        b->next_v[e] = b->v[e] + h * b->acceleration[0][e];
        b->displacement[e] = h * b->next_v[e];
    }
    move(b->constants, b->q, b->displacement, b->next_q);
}

/*
 * The Runge-Kutta method of fourth order. With attitude angles it is the classical one; a
 * quaternion moves by exponentials, of which the last two follow each other.
 */
static INLINE void rk4(const real h, Block *b)
{
    const real *a1 = b->acceleration[0], *a2 = b->acceleration[1];
    const real *a3 = b->acceleration[2], *a4 = b->acceleration[3];
    const real half_step = R(0.5) * h;
    const real sixth = h / R(6.0);
    accelerate(b->constants, b->q, b->v, b->begin, b->wrenches, b->acceleration[0]);
    VECTORISE
    for (int e = 0; e < NV * LANES; ++e) {
        b->displacement[e] = half_step * b->v[e];
        b->rate[e] = b->v[e] + half_step * a1[e];
    }
    move(b->constants, b->q, b->displacement, b->half);
    accelerate(b->constants, b->half, b->rate, b->middle, b->wrenches, b->acceleration[1]);
    VECTORISE
    for (int e = 0; e < NV * LANES; ++e) {
        b->displacement[e] = half_step * b->rate[e];
        b->rate[e] = b->v[e] + half_step * a2[e];
    }
    move(b->constants, b->q, b->displacement, b->later);
    accelerate(b->constants, b->later, b->rate, b->middle, b->wrenches, b->acceleration[2]);
    VECTORISE
    for (int e = 0; e < NV * LANES; ++e) {
        b->displacement[e] = h * (b->rate[e] - R(0.5) * b->v[e]);
        b->rate[e] = b->v[e] + h * a3[e];
    }
    move(b->constants, b->half, b->displacement, b->later);
    accelerate(b->constants, b->later, b->rate, b->end, b->wrenches, b->acceleration[3]);
    VECTORISE
    for (int e = 0; e < NV * LANES; ++e) {
        b->displacement[e] = half_step * (b->v[e] + sixth * (a1[e] + a2[e] - a3[e]));
    }
    move(b->constants, b->q, b->displacement, b->half);
    VECTORISE
    for (int e = 0; e < NV * LANES; ++e) {
        const real first = a1[e] + a2[e];
        b->displacement[e] = half_step * (b->v[e] + sixth * (first + R(3.0) * a3[e]));
        b->next_v[e] = b->v[e] + sixth * (first + a2[e] + R(2.0) * a3[e] + a4[e]);
    }
    move(b->constants, b->half, b->displacement, b->next_q);
}
