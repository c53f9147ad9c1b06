/* MuJoCo's model and data of one rover, for mbs/rover_state.py. What is missing of errors is on purpose: MuJoCo ends the process where it
   has no memory or a call breaks its rules, and the functions called here and in the kernels have no other errors. */

#include "model.h"

#include <mujoco/mujoco.h>
#include <stdlib.h>

_Static_assert(sizeof(mjtNum) == sizeof(double), "kernels compute in double precision");

enum { COMPILED, ADDRESSES = 0 };

const char *model_open(void *const *arrays, void **own)
{
    /* MuJoCo writes its warnings into the working directory unless it is told not to; a lost state is caught by the step. */
    mjLogConfig config = mju_getLogConfig();
    config.logto_file = 0;
    mju_setLogConfig(config);

    const int64_t *compiled = arrays[COMPILED];
    mjModel *m = mj_loadModelBuffer(compiled + 1, compiled[0]);
    mjData *d = m ? mj_makeData(m) : NULL;
    int64_t *addresses = calloc(2, sizeof *addresses);
    if (!d || !addresses) {
        mj_deleteData(d);
        mj_deleteModel(m);
        free(addresses);
        return "MuJoCo does not take the model that the FMU holds: unpack the FMU again";
    }
    addresses[0] = (int64_t)(intptr_t)m;
    addresses[1] = (int64_t)(intptr_t)d;
    /* In the order of Bodies in mbs/rover_memory.py. */
    void *held[] = {addresses,       m->opt.gravity, m->body_pos, m->body_mass, m->body_ipos, m->body_iquat,   m->body_inertia,
                    d->qpos, d->qvel,     d->xpos,    d->xmat,     d->cvel,      d->subtree_com, d->cdof};
    for (size_t i = 0; i < sizeof held / sizeof *held; i++)
        own[i] = held[i];
    return NULL;
}

void model_close(void **own)
{
    int64_t *addresses = own[ADDRESSES];
    mj_deleteData((mjData *)(intptr_t)addresses[1]);
    mj_deleteModel((mjModel *)(intptr_t)addresses[0]);
    free(addresses);
}
