/*
 * The base stands first: position and quaternion (x, y, z, w) in q, linear and angular velocity
 * along its own axes in v and in displacements. Joints follow.
 */
typedef struct {
    real q[NQ];     /* with a quaternion of unit length */
    real length;    /* of the quaternion in x */
    real map[6][7]; /* displacement of the base, by its entries of q in x */
} Place;

static void locate(const real *x, Place *at)
{
    const real squared = x[3] * x[3] + x[4] * x[4] + x[5] * x[5] + x[6] * x[6];
    const real length = sqrt(squared);
    const real scale = length * (1.0 / squared); /* not finite where the square is 0 or infinite */
    const real qx = x[3] * scale, qy = x[4] * scale, qz = x[5] * scale, qw = x[6] * scale;
    const real turn[3][3] = {
        {1.0 - 2.0 * (qy * qy + qz * qz), 2.0 * (qx * qy + qz * qw), 2.0 * (qx * qz - qy * qw)},
        {2.0 * (qx * qy - qz * qw), 1.0 - 2.0 * (qx * qx + qz * qz), 2.0 * (qy * qz + qx * qw)},
        {2.0 * (qx * qz + qy * qw), 2.0 * (qy * qz - qx * qw), 1.0 - 2.0 * (qx * qx + qy * qy)},
    };
    const real spin[3][4] = {{qw, qz, -qy, -qx}, {-qz, qw, qx, -qy}, {qy, -qx, qw, -qz}};
    for (int i = 0; i < NQ; ++i) {
        at->q[i] = i < 3 || i > 6 ? x[i] : x[i] * scale;
    }
    at->length = length;
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 7; ++j) {
            at->map[i][j] = j < 3 ? turn[i][j] : 0.0;
            at->map[3 + i][j] = j < 3 ? 0.0 : 2.0 / length * spin[i][j - 3];
        }
    }
}

/* Rates of q that belong to v. */
static void rates(const Constants *constants, const Place *at, const real *v, real *q_dot)
{
    MODULE(coordinate_rates)(constants, at->q, v, q_dot);
    for (int i = 3; i < 7; ++i) {
        q_dot[i] *= at->length;
    }
}
