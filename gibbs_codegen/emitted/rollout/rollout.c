/* From here on the source is the same for every robot. */
#include "rollout/transpose.c"

#include "rollout/rows.c"

#include "rollout/inputs.c"

#include "rollout/steps.c"

#include "rollout/ends.c"

#include "rollout/run.c"
