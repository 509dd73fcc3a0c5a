/* Stage, slider and LuGre contact, integrated by classical Runge-Kutta steps of one fixed length.

   Own equations [kang2007, eq. 3.16 to 3.25], no code of the package; the drive is a table of straight lines.
     y'' = -w^2 y - 2 zeta w y' + C w^2 u - [reaction] F/m,    m_e x'' = F
     z'  = v - s0 |v| z / g,   v = y' - x',   F = s0 z + s1 z' + s2 v
     g   = (F_C + (F_S - F_C) exp(-(v/v_s)^2)) (1 + a sign v) (1 + b sin(2 pi x/L))
   A clamped slider moves with the stage: x = y, F = 0.  SI throughout. */
#include <math.h>

struct plant {
    double gain, w, zeta, m, me, s0, s1, s2, fc, fs, vs, asymmetry, unevenness, length;
    double reaction, clamped;
};

static void slope(const struct plant *p, double u, const double q[5], double d[5])
{
    const double v = q[1] - q[3];
    double g = (p->fc + (p->fs - p->fc) * exp(-(v / p->vs) * (v / p->vs))) *
               (1.0 + p->asymmetry * ((v > 0.0) - (v < 0.0)));
    double f;
    if (p->unevenness != 0.0)
        g *= 1.0 + p->unevenness * sin(6.283185307179586 * q[2] / p->length);
    d[4] = p->clamped != 0.0 ? 0.0 : v - p->s0 * fabs(v) * q[4] / g;
    f = p->clamped != 0.0 ? 0.0 : p->s0 * q[4] + p->s1 * d[4] + p->s2 * v;
    d[0] = q[1];
    d[1] = p->w * p->w * (p->gain * u - q[0]) - 2.0 * p->zeta * p->w * q[1];
    if (p->reaction != 0.0)
        d[1] -= f / p->m;
    d[2] = q[3];
    d[3] = f / p->me;
}

/* Fill positions[n] of the slider, `every` steps of h seconds apart, from rest at zero. */
void walk(const struct plant *p, const double *times, const double *volts, long knots, double h, long every,
          long n, double *positions)
{
    double q[5] = {0}, k[4][5], at[5];
    const double share[4] = {0.0, 0.5, 0.5, 1.0};
    long piece = 0;
    for (long i = 0; i < n; i++) {
        positions[i] = p->clamped != 0.0 ? q[0] : q[2];
        for (long step = 0; step < every; step++) {
            const double t = (double)(i * every + step) * h;
            for (int s = 0; s < 4; s++) {
                const double now = t + share[s] * h;
                while (piece + 2 < knots && times[piece + 1] <= now - 1e-3 * h)
                    piece++;
                while (piece > 0 && times[piece] > now)
                    piece--;
                const double span = times[piece + 1] - times[piece];
                const double u = volts[piece] + (volts[piece + 1] - volts[piece]) * (now - times[piece]) / span;
                for (int j = 0; j < 5; j++)
                    at[j] = q[j] + (s > 0 ? share[s] * h * k[s - 1][j] : 0.0);
                slope(p, u, at, k[s]);
            }
            for (int j = 0; j < 5; j++)
                q[j] += h / 6.0 * (k[0][j] + 2.0 * k[1][j] + 2.0 * k[2][j] + k[3][j]);
        }
    }
}
