/* MuJoCo's algorithms behind the interface of the benchmark, on one model held by the library. */
#include <mujoco/mujoco.h>
#include <string.h>

#define EXPORT __attribute__((visibility("default")))

static mjModel *model;
static mjData *data;

/* Loads a model; returns 0, or writes to `error` why not and returns 1. */
EXPORT int mujoco_load(const char *path, char *error, int size)
{
    model = mj_loadXML(path, NULL, error, size);
    data = model ? mj_makeData(model) : NULL;
    return data == NULL;
}

static void set_state(const double *q, const double *v)
{
    memcpy(data->qpos, q, (size_t)model->nq * sizeof *q);
    memcpy(data->qvel, v, (size_t)model->nv * sizeof *v);
}

static void mass_matrix(void)
{
    mj_kinematics(model, data);
    mj_comPos(model, data);
    mj_crb(model, data);
}

static void effects(double *result)
{
    mj_comVel(model, data);
    mj_rne(model, data, 0, result);
}

/* Leaves the mass matrix in MuJoCo's own memory, sparse. */
EXPORT void mujoco_mass_matrix_and_effects(const double *q, const double *v, const double *tau,
                                           double *first, double *second)
{
    (void)tau;
    (void)first;
    set_state(q, v);
    mass_matrix();
    effects(second);
}

/* Writes the mass matrix dense. */
EXPORT void mujoco_fetch_mass_matrix(double *first, double *second)
{
    (void)second;
    mj_fullM(model, data, first);
}

EXPORT void mujoco_forward_dynamics(const double *q, const double *v, const double *tau,
                                    double *first, double *second)
{
    (void)second;
    set_state(q, v);
    mass_matrix();
    mj_factorM(model, data);
    effects(data->qfrc_bias);
    for (long i = 0; i < model->nv; ++i)
        data->qfrc_smooth[i] = tau[i] - data->qfrc_bias[i];
    mj_solveM(model, data, first, data->qfrc_smooth, 1);
}
