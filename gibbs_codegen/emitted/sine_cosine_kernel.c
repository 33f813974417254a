/* `beyond` becomes 1 where the angle is beyond ANGLE_LIMIT or not finite. */
static INLINE void KERNEL(const NUMBER *angle, NUMBER *sine, NUMBER *cosine, BITS *beyond)
{
    AS_WRITTEN
    const NUMBER x = *angle;
    const NUMBER shifted = x * R(0.6366197723675813430755) + ROUND;
    const NUMBER m = shifted - ROUND;
    const NUMBER first = x - m * HALF_PI_1;
    const NUMBER second = m * HALF_PI_2;
    const NUMBER third = HALF_PI_REST(m);
    const NUMBER r = first - (second + third);
    const NUMBER lost = ((first - r) - second) - third;
    const NUMBER z = r * r;
    const NUMBER zz = z * z;
    const NUMBER sine_of_rest = r + ((r * z) * SINE_SERIES(z, zz) + lost);
    const NUMBER cosine_of_rest = (R(1.0) - R(0.5) * z) + zz * COSINE_SERIES(z, zz);
    const bits one = 1;
    BITS angle_bits, quadrant, rest_bits, sine_bits, cosine_bits;
    memcpy(&angle_bits, &x, sizeof x);
    memcpy(&quadrant, &shifted, sizeof x);
    memcpy(&rest_bits, &r, sizeof x);
    memcpy(&sine_bits, &sine_of_rest, sizeof x);
    memcpy(&cosine_bits, &cosine_of_rest, sizeof x);
    /* The sine of a negative zero is a negative zero. */
    sine_bits |= rest_bits & ~(bits)MAGNITUDE;
    const BITS swap = (sine_bits ^ cosine_bits) & ((bits)0 - (quadrant & one));
    sine_bits ^= swap ^ ((quadrant & (one + one)) << SIGN_SHIFT);
    cosine_bits ^= swap ^ (((quadrant + one) & (one + one)) << SIGN_SHIFT);
    memcpy(sine, &sine_bits, sizeof x);
    memcpy(cosine, &cosine_bits, sizeof x);
    *beyond = ((bits)ANGLE_LIMIT - (angle_bits & MAGNITUDE)) >> (SIGN_SHIFT + 1);
}
