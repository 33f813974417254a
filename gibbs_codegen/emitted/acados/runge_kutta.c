static const real stage_ahead[] = {0.0, 0.5, 0.5, 1.0};
static const real stage_share[] = {1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0};
