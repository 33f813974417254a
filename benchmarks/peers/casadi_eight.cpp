// The C that CasADi wrote with eight doubles for a real number: eight states a call. FUNCTIONS is
// GLUE(name) for each of its functions.
#include <math.h>

typedef double Eight __attribute__((vector_size(64)));

// glibc's vector sine and cosine take as many numbers at once as the processor's registers do.
#if defined(__AVX512F__)
typedef Eight Part;
extern "C" Part _ZGVeN8v_sin(Part);
extern "C" Part _ZGVeN8v_cos(Part);
#define PART_SIN _ZGVeN8v_sin
#define PART_COS _ZGVeN8v_cos
#elif defined(__AVX2__)
typedef double Part __attribute__((vector_size(32)));
extern "C" Part _ZGVdN4v_sin(Part);
extern "C" Part _ZGVdN4v_cos(Part);
#define PART_SIN _ZGVdN4v_sin
#define PART_COS _ZGVdN4v_cos
#else
typedef double Part;
#define PART_SIN sin
#define PART_COS cos
#endif

constexpr int parts = sizeof(Eight) / sizeof(Part);

union Split {
    Eight whole;
    Part part[parts];
};

// A class, since C's vectors do not take scalars as values, which CasADi's constants are.
struct Real {
    Eight value;
    Real() = default;
    Real(double number) : value(number - Eight{}) {}
    Real(Eight numbers) : value(numbers) {}
};

static inline Real operator+(Real a, Real b) { return a.value + b.value; }
static inline Real operator-(Real a, Real b) { return a.value - b.value; }
static inline Real operator*(Real a, Real b) { return a.value * b.value; }
static inline Real operator/(Real a, Real b) { return a.value / b.value; }
static inline Real operator-(Real a) { return -a.value; }

static inline Real sin(Real a)
{
    Split angle, sine;
    angle.whole = a.value;
    for (int i = 0; i < parts; ++i)
        sine.part[i] = PART_SIN(angle.part[i]);
    return sine.whole;
}

static inline Real cos(Real a)
{
    Split angle, cosine;
    angle.whole = a.value;
    for (int i = 0; i < parts; ++i)
        cosine.part[i] = PART_COS(angle.part[i]);
    return cosine.whole;
}

#define casadi_real Real
#define CASADI_SYMBOL_EXPORT static // the compiler then sees that no pointer is null
#include GENERATED

static inline const Real *input(const double *block)
{
    return reinterpret_cast<const Real *>(block);
}

static inline Real *output(double *block)
{
    return reinterpret_cast<Real *>(block);
}

#define GLUE(name)                                                                              \
    extern "C" __attribute__((visibility("default")))                                           \
    void casadi_##name(const double *q, const double *v, const double *tau, double *first,      \
                       double *second)                                                          \
    {                                                                                           \
        const Real *arguments[] = {input(q), input(v), input(tau)};                             \
        Real *results[] = {output(first), output(second)};                                      \
        name(arguments, results, nullptr, nullptr, 0);                                          \
    }

FUNCTIONS
