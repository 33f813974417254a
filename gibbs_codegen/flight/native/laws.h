/* Laws of control: the inputs that are commanded, and what a law remembers. */

#ifndef GIBBS_CODEGEN_LAWS_H
#define GIBBS_CODEGEN_LAWS_H

#include <string.h>

#include "allocation.h"
#include "geometric.h"
#include "kinematics.h"
#include "loop.h"

/* Desired accelerations, corrected by the errors of a state. */
static void corrected(const Loop *f, const Moment *now, number *restrict out, Room room)
{
    const Layout *const at = layout_of(f);
    const ptrdiff_t n = at->coordinates, m = at->velocities;
    const number *const wanted = now->wanted;
    number *const off = take(&room, 2 * m);
    errors_of(at, wanted, now->q, now->v, off);
    for (ptrdiff_t i = 0; i < m; ++i) {
        off[i] += error_correction(f, now, i);
        off[i] = f->gains.stiffness[i] * off[i] + f->gains.damping[i] * off[m + i];
        out[i] = wanted[n + m + i] + off[i];
    }
    if (has_quaternion(at)) {
        carried_over(at, wanted, now->q, now->v, off, out);
    }
}

/* Inputs of the desired acceleration, corrected by the tracking errors. */
static flags computed_torque(const Loop *f, const Moment *now, number *inputs, Room room)
{
    const ptrdiff_t m = layout_of(f)->velocities;
    number *const acceleration = take(&room, m), *const force = take(&room, m);
    corrected(f, now, acceleration, room);
    f->functions.inverse_dynamics(OF(f->model), now->q, now->v, acceleration, force);
    return allocate(f, now, now->q, &now->attitude, force, inputs, room);
}

/* Inputs of the desired motion, whatever the state. */
static flags open_loop(const Loop *f, const Moment *now, number *inputs, Room room)
{
    const ptrdiff_t n = layout_of(f)->coordinates, m = layout_of(f)->velocities;
    const number *const wanted = now->wanted;
    const Attitude attitude = attitude_of(layout_of(f), wanted);
    number *const force = take(&room, m);
    f->functions.inverse_dynamics(OF(f->model), wanted, wanted + n, wanted + n + m, force);
    return allocate(f, now, wanted, &attitude, force, inputs, room);
}

/* Commanded inputs. Returns where the rotors cannot produce them. */
static flags command(const Loop *f, const Moment *now, number *inputs, Room room)
{
    const size_t size = (size_t)inputs_of(f) * sizeof *inputs;
    const flags none = {0};
    switch (f->law) {
    case COMPUTED_TORQUE:
        return computed_torque(f, now, inputs, room);
    case OPEN_LOOP:
        return open_loop(f, now, inputs, room);
    case GEOMETRIC:
        return geometric(f, now, inputs, room);
    case HELD:
        memcpy(inputs, f->held, size);
        return none;
    default: /* OFF */
        memset(inputs, 0, size);
        return none;
    }
}

/* Room that `command` takes. */
static ptrdiff_t room_of_law(const Loop *f)
{
    const ptrdiff_t m = layout_of(f)->velocities, allocating = room_of_allocation(f);
    /* Of errors and a Jacobian, accelerations and forces. */
    return 5 * m + (allocating > 2 * m ? allocating : 2 * m);
}

/* How what a law remembers grows: the integrals of the errors, if there are any. */
static void remember(const Loop *f, const Moment *now, number *growth, Room room)
{
    if (layout_of(f)->memory && f->law == GEOMETRIC) {
        remember_centre(f, now, growth);
    } else if (layout_of(f)->memory) {
        number *const off = take(&room, 2 * layout_of(f)->velocities);
        errors_of(layout_of(f), now->wanted, now->q, now->v, off);
        memcpy(growth, off, (size_t)layout_of(f)->memory * sizeof *growth);
    }
}

#endif
