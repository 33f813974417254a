/*
 * Discrete dynamics as acados calls them. Arguments are BLASFEO vectors; the derivatives by (u, x)
 * are transposed, which row-major matrices are for BLASFEO already. The text before defines NX, NU,
 * MODULE(name), and `constants_at`, the constants for the parameters p of a stage.
 */
static void taken(void **in, double *x, double *u)
{
    const struct blasfeo_dvec_args *state = in[0], *sent = in[1];
    blasfeo_unpack_dvec(NX, state->x, state->xi, x, 1);
    blasfeo_unpack_dvec(NU, sent->x, sent->xi, u, 1);
}

int MODULE(acados_derivatives)(void **in, void **out, void *p)
{
    double x[NX], u[NU], x_next[NX], by_x[NX * NX], by_u[NX * NU];
    const struct blasfeo_dvec_args *after = out[0];
    const struct blasfeo_dmat_args *slopes = out[1];
    Constants room;
    taken(in, x, u);
    MODULE(acados_slopes)(constants_at(p, &room), x, u, x_next, by_x, by_u);
    blasfeo_pack_dvec(NX, x_next, 1, after->x, after->xi);
    blasfeo_pack_dmat(NU, NX, by_u, NU, slopes->A, slopes->ai, slopes->aj);
    blasfeo_pack_dmat(NX, NX, by_x, NX, slopes->A, slopes->ai + NU, slopes->aj);
    return 0;
}

int MODULE(acados)(void **in, void **out, void *p)
{
    double x[NX], u[NU], x_next[NX];
    const struct blasfeo_dvec_args *after = out[0];
    Constants room;
    taken(in, x, u);
    MODULE(acados_step)(constants_at(p, &room), x, u, x_next);
    blasfeo_pack_dvec(NX, x_next, 1, after->x, after->xi);
    return 0;
}
