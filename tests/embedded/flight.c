/*
 * Flies a law with motors, servos and a battery, sampled, in steps of Runge and Kutta, and prints
 * the bytes of the state at each sample: coordinates, velocities, states of the actuators.
 *
 * cases.h, written by whoever compiles it, includes the header of the laws and gives
 *
 *     real, Constants, Rotors      types of the module
 *     MODEL(name), LAW             a function or constant of the module; the law
 *     COORDINATES, VELOCITIES, INPUTS, STATES, QUATERNION   lengths, and where the quaternion is
 *     SAMPLES, STEPS, STEP         samples, steps of each, and how long these are, s
 *     gains, reference             of the law
 *     begin, least, most           the state without actuators; limits of commands
 */

#include <math.h>
#include <stdint.h>
#include <stdio.h>

#include "cases.h"

enum { SIZE = COORDINATES + VELOCITIES + STATES };

static const Constants *const constants = &MODEL(default_constants);

static void rates(const real y[SIZE], const real command[INPUTS], real rate[SIZE])
{
    real q[COORDINATES], u[INPUTS], length = 0;
    const real *const v = y + COORDINATES, *const x = v + VELOCITIES;
    for (int i = 0; i < COORDINATES; ++i) {
        q[i] = y[i];
    }
    for (int i = QUATERNION; i < QUATERNION + 4; ++i) {
        length += q[i] * q[i];
    }
    length = (real)sqrt((double)length);
    for (int i = QUATERNION; i < QUATERNION + 4; ++i) {
        q[i] /= length;
    }
    MODEL(inputs_of)(constants, q, v, x, command, u);
    MODEL(coordinate_rates)(constants, q, v, rate);
    MODEL(forward_dynamics)(constants, q, v, u, rate + COORDINATES);
    MODEL(actuator_rates)(constants, x, command, rate + COORDINATES + VELOCITIES);
}

static void step(real y[SIZE], const real command[INPUTS])
{
    const real shares[] = {0, STEP / 2, STEP / 2, STEP}, weights[] = {1, 2, 2, 1};
    real sum[SIZE] = {0}, rate[SIZE] = {0}, at[SIZE];
    for (int stage = 0; stage < 4; ++stage) {
        for (int i = 0; i < SIZE; ++i) {
            at[i] = y[i] + shares[stage] * rate[i];
        }
        rates(at, command, rate);
        for (int i = 0; i < SIZE; ++i) {
            sum[i] += weights[stage] * rate[i];
        }
    }
    for (int i = 0; i < SIZE; ++i) {
        y[i] += STEP / 6 * sum[i];
    }
}

static void clip(real values[INPUTS], const real low[INPUTS], const real high[INPUTS])
{
    for (int i = 0; i < INPUTS; ++i) {
        values[i] = values[i] < low[i] ? low[i] : values[i] > high[i] ? high[i] : values[i];
    }
}

int main(void)
{
    Rotors rotors;
    State state;
    real y[SIZE], u[INPUTS], command[INPUTS];
    MODEL(init_rotors)(constants, &rotors);
    for (int i = 0; i < COORDINATES + VELOCITIES; ++i) {
        y[i] = begin[i];
    }
    for (int sample = 0; sample < SAMPLES; ++sample) {
        for (int i = 0; i < COORDINATES; ++i) {
            state.q[i] = y[i];
        }
        for (int i = 0; i < VELOCITIES; ++i) {
            state.v[i] = y[COORDINATES + i];
        }
        LAW(constants, &rotors, &gains, &state, &reference, u);
        clip(u, gains.least, gains.most);
        MODEL(command_of)(constants, reference.q, reference.v, u, command);
        clip(command, least, most);
        if (sample == 0) {
            MODEL(actuator_state_of)(constants, command, y + COORDINATES + VELOCITIES);
        }
        for (int k = 0; k < STEPS; ++k) {
            step(y, command);
        }
        const unsigned char *bytes = (const unsigned char *)y;
        for (size_t k = 0; k < sizeof y; ++k) {
            printf("%02x", (unsigned)bytes[k]);
        }
        printf("\n");
    }
    return 0;
}
