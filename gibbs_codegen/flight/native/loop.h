/* What a closed loop consists of, as Python fills it in: `integration/compiled_loop.py`. */

#ifndef GIBBS_CODEGEN_LOOP_H
#define GIBBS_CODEGEN_LOOP_H

#include <stddef.h>

#include "number.h"

enum { BASE = 6, POWERS = 6 };
enum { COMPUTED_TORQUE = 0, OPEN_LOOP = 1, OFF = 2, HELD = 3, GEOMETRIC = 4 };

typedef void Forward(ROBOT, const number *, const number *, const number *, number *);
typedef void Inverse(ROBOT, const number *, const number *, const number *, number *);
typedef void Matrix(ROBOT, const number *, number *);
typedef void Pushed(ROBOT, const number *, const number *, const number *, const number *,
                    number *);
typedef void Forces(ROBOT, const number *, const number *, number *);
typedef void Places(ROBOT, const number *, number *);
typedef void Moving(ROBOT, const number *, const number *, number *);

/* Functions of an emitted module, by their addresses. */
typedef struct {
    Forward *forward_dynamics;
    Inverse *inverse_dynamics;
    Matrix *input_matrix;
    Pushed *forward_dynamics_with_wrenches;
    Forces *wrench_forces;
    Places *frame_poses;
    Places *frame_jacobians;
    Moving *frame_velocities;
    Moving *frame_bias_accelerations;
    Matrix *centre_of_mass;
    Matrix *centre_of_mass_jacobian;
} Functions;

/* How many there are of what, and where. */
typedef struct {
    ptrdiff_t coordinates;
    ptrdiff_t velocities;
    ptrdiff_t rotors;
    ptrdiff_t memory;       /* numbers that the law remembers */
    ptrdiff_t attitude;     /* places in the velocities: where the attitude's begin, */
    ptrdiff_t joints;       /* where the joints' begin, */
    ptrdiff_t position;     /* and where the position's begin */
    ptrdiff_t axes[3];      /* 0 to 2, that attitude angles turn about, from the outermost */
    ptrdiff_t middle_angle; /* place of the angle that has a singularity; -1: quaternion, */
    ptrdiff_t quaternion;   /* place in the coordinates where that begins, */
    ptrdiff_t placed;       /* and where the position begins */
} Layout;

/* The desired motion: a polynomial between each two knots. */
typedef struct {
    ptrdiff_t pieces;
    double begin;               /* of the first piece, s */
    double piece;               /* length of a piece, s */
    const double *coefficients; /* [pieces][6][coordinates] */
} Desired;

/* Centre of mass of the robot that the geometric law knows; not there under other laws. */
typedef struct {
    const number *mass;         /* kg */
    const number *weight;       /* [3]: the force that holds the robot, world axes, N */
    const number *coefficients; /* [pieces][6][3] of its desired motion, with the knots of that */
} Centre;

/* Gains of the tracking errors. */
typedef struct {
    const number *stiffness; /* [velocities] */
    const number *damping;   /* [velocities] */
    const number *integral;  /* rate of integral action, 1/s */
} Gains;

/* Rotors of the robot that flies or of the one that the law knows. */
typedef struct {
    int move;               /* whether joints move them; then their wrenches are those of zero */
    const number *centre;   /* [3]: from where the position is to the base centre, base axes, m */
    const number *wrenches; /* [rotors][6] of unit thrusts: forces, torques about the centre */
} Rotors;

/* How the rotors that the law knows share a wrench on the base. */
typedef struct {
    int limited;
    int refuses;                /* whether a wrench that no thrusts produce is refused */
    const number *distribution; /* [rotors][6]: thrusts of a force and a torque */
    const number *least;        /* [rotors]: limits of the thrusts */
    const number *most;
} Sharing;

/* Limits and lag of motors and joints. */
typedef struct {
    int limited;
    int lags;
    int compensates; /* whether commands make up for the lag */
    const number *least; /* [rotors + joints]: limits of the inputs */
    const number *most;
    const number *lag; /* [rotors]: time constants of the motors, 0 for none, */
    const number *pace; /* and what 1 is divided by them, 0 for those without */
} Actuators;

/* What acts on the robot besides its inputs: a push, wind, walls, rotors that spin, and payloads.
 * Numbers of frames and rotors are from 0, and stand among the other numbers. */
typedef struct {
    ptrdiff_t frames;           /* 0 where nothing acts */
    const double *push;         /* [frames][6]: its wrenches */
    const double *coefficients; /* [frames][6]: of drag; NULL without wind */
    const double *wind;         /* [3]: velocity of the steady wind */
    ptrdiff_t gusts;
    const double *gust; /* [gusts][5]: begin, duration, and half of the greatest velocity */
    ptrdiff_t walls;
    const double *wall; /* [walls][9]: frame, point, normal, stiffness, damping */
    ptrdiff_t spins;
    const double *spin; /* [spins][6]: rotor, frame, axis in the frame, angular momentum */
    ptrdiff_t payloads;
    const double *payload; /* [payloads][2]: frame, mass, of those that are there */
    const number *gravity; /* acceleration along z */
} Environment;

/* Where a flight cannot go on. */
typedef struct {
    const number *bounds;   /* [2][velocities]: errors beyond which control is lost */
    double largest_theta_0; /* beyond it angles are singular */
} Envelope;

typedef struct {
    Functions functions;
    const void *plant; /* constants of the robot that flies, */
    const void *model; /* and of the one that the law knows */
    const number *losses; /* [velocities]: damping of the robot itself */
    Layout layout;
    Desired desired;
    Centre centre;
    Gains gains;
    Rotors plant_rotors;
    Rotors model_rotors;
    Sharing sharing;
    Actuators actuators;
    Environment environment;
    Envelope envelope;
    int law;
    const number *held; /* [rotors + joints]: inputs that are commanded all through, under HELD */
    number *guesses;    /* [rotors]: which thrusts are at limits; zeros before the first call */
    number *scratch;    /* [gibbs_codegen_loop_room] */
} Loop;

/* Attitude of the base: a quaternion of unit length, or sines and cosines of its angles. */
typedef struct {
    const number *quaternion;
    number sine[3];
    number cosine[3];
} Attitude;

/* A state at a time: `q` has a quaternion of unit length; `thrusts` are there if motors lag. */
typedef struct {
    double time;
    const number *wanted; /* desired coordinates, velocities and accelerations, one after another */
    const number *q;
    const number *v;
    const number *thrusts;
    const number *memory;
    flags going; /* flights that have not ended */
    Attitude attitude;
} Moment;

/* Room for numbers. What is taken is free again where the copy ends that it was taken from. */
typedef struct {
    number *free;
} Room;

static number *take(Room *room, ptrdiff_t count)
{
    number *const taken = room->free;
    room->free += count;
    return taken;
}

/* Room for as many numbers of one state. */
static double *take_plain(Room *room, ptrdiff_t count)
{
    return (double *)take(room, (count + LANES - 1) / LANES);
}

/* LAYOUT is that of the one robot that a build is for, if it is: then compilers know all places. */
static INLINE const Layout *layout_of(const Loop *f)
{
#ifdef LAYOUT
    static const Layout fixed = LAYOUT;
    (void)f;
    return &fixed;
#else
    return &f->layout;
#endif
}

static ptrdiff_t inputs_of(const Loop *f)
{
    return layout_of(f)->rotors + layout_of(f)->velocities - BASE;
}

/* Place of the law's memory in the state: after coordinates, velocities, work and thrusts. */
static ptrdiff_t memory_of(const Loop *f)
{
    const Layout *at = layout_of(f);
    return at->coordinates + at->velocities + 1 + (f->actuators.lags ? at->rotors : 0);
}

/* Length of the state. */
static ptrdiff_t size_of(const Loop *f)
{
    return memory_of(f) + layout_of(f)->memory;
}

static int has_quaternion(const Layout *at)
{
    return at->middle_angle < 0;
}

#endif
