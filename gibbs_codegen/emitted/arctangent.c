/*
 * Arctangent. The nearest of 0 and pi/4 is subtracted from the angle; the tangent of the rest is a
 * quotient, and a polynomial gives the rest itself. Without branches and library calls, compilers
 * vectorise loops over lanes.
 */
#ifdef SINGLE
#define QUARTER_PI_LOST R(-2.7827534e-08)
#define ARCTANGENT_SERIES(z, zz)                                                               \
    ((R(-0.33333315180516452) + (z) * R(0.19998470972642292)) +                                \
     (zz) * ((R(-0.14243522357516257) + (z) * R(0.10593727697293397)) +                        \
             (zz) * R(-0.060779922917551546)))
#else
#define QUARTER_PI_LOST R(3.8981718325193755e-17)
#define ARCTANGENT_SERIES(z, zz)                                                               \
    (((R(-0.33333333333330148) + (z) * R(0.19999999999088228)) +                               \
      (zz) * (R(-0.14285714195197036) + (z) * R(0.11111106650839635))) +                       \
     ((zz) * (zz)) * ((R(-0.090907823465502914) + (z) * R(0.076900673508722222)) +             \
                      (zz) * ((R(-0.066411127992986118) + (z) * R(0.056924944700179225)) +     \
                              (zz) * (R(-0.043589651738898149) + (z) * R(0.02125823611143757)))))
#endif

/* Of a number from -1 to 1. */
static INLINE real arctangent(const real x)
{
    AS_WRITTEN
    const real half = R(0.5), size = LIBRARY(fabs)(x);
    const real above = half + LIBRARY(copysign)(half, size - R(0.41421356237309505));
    const real angle = above * R(0.78539816339744831);
    const real r = (size - above) / (above * size + R(1.0));
    const real z = r * r;
    const real zz = z * z;
    const real rest = (r * z) * ARCTANGENT_SERIES(z, zz) + angle * QUARTER_PI_LOST;
    return LIBRARY(copysign)(angle + (r + rest), x);
}
