"""What every C file has beside its formulas: steps that locate events, or rows of a map.

The names that begin with ``NAME`` are replaced by that of the model.
"""

CONTINUOUS = r"""
typedef struct {
    double t, entered, h;  /* time, when the mode was entered, the next step */
    int mode;              /* a slide is one of its own: see NAME_mode */
    double x[NAME_N];
    int armed[NAME_E];     /* guards that have been below zero since the mode was entered */
    double band[NAME_E];   /* what is zero within rounding */
    double rtol;
} NAME_state;

typedef struct { double t0, t1; const double *u0, *u1; } NAME_inputs;  /* linear between */

static void NAME_at(const NAME_inputs *in, double t, double *u)
{
    double part = in->t1 > in->t0 ? (t - in->t0) / (in->t1 - in->t0) : 0.0;
    u[0] = 0.0;  /* where there are no inputs */
    for (int i = 0; i < NAME_INPUTS; i++) u[i] = in->u0[i] + part * (in->u1[i] - in->u0[i]);
}

static double NAME_value(const NAME_state *s, const NAME_inputs *in, int edge, double t,
                         const double *x)
{
    double u[NAME_U];
    NAME_at(in, t, u);
    return NAME_guard(edge, x, u, t - s->entered, t);
}

static int NAME_fires(const NAME_state *s, int edge, double value)
{
    return s->armed[edge] ? value >= 0.0 : value > s->band[edge];
}

/* One step of Dormand and Prince of order five; its error relative to the tolerance. */
static double NAME_rk(const NAME_state *s, const NAME_inputs *in, double h, double *y,
                      double k[7][NAME_N])
{
    static const double c[7] = {0, .2, .3, .8, 8. / 9, 1, 1};
    static const double a[7][6] = {
        {0}, {.2}, {3. / 40, 9. / 40}, {44. / 45, -56. / 15, 32. / 9},
        {19372. / 6561, -25360. / 2187, 64448. / 6561, -212. / 729},
        {9017. / 3168, -355. / 33, 46732. / 5247, 49. / 176, -5103. / 18656},
        {35. / 384, 0, 500. / 1113, 125. / 192, -2187. / 6784, 11. / 84}};
    static const double e[7] = {71. / 57600, 0, -71. / 16695, 71. / 1920,
                                -17253. / 339200, 22. / 525, -1. / 40};
    double u[NAME_U], worst = 0.0;
    for (int i = 0; i < 7; i++) {
        for (int n = 0; n < NAME_N; n++) {
            double sum = 0.0;
            for (int j = 0; j < i; j++) sum += a[i][j] * k[j][n];
            y[n] = s->x[n] + h * sum;
        }
        NAME_at(in, s->t + c[i] * h, u);
        NAME_rhs(s->mode, y, u, s->t + c[i] * h, k[i]);
    }
    for (int n = 0; n < NAME_N; n++) {
        double off = 0.0, size = fmax(fabs(s->x[n]), fabs(y[n]));
        for (int i = 0; i < 7; i++) off += e[i] * k[i][n];
        off = fabs(h * off) / (s->rtol * (size + 1e-2 * NAME_size[n]));
        if (!(off <= worst)) worst = off;
    }
    return worst;
}

/* Which guards of a mode that has just been entered have to fall below zero before they count. */
static void NAME_arm(NAME_state *s, const NAME_inputs *in)
{
    double f[NAME_N], u[NAME_U], low[NAME_N], high[NAME_N], moved[NAME_N];
    double ahead = 1e-6 * (in->t1 > in->t0 ? in->t1 - in->t0 : 1.0);
    NAME_at(in, s->t, u);
    NAME_rhs(s->mode, s->x, u, s->t, f);
    for (int n = 0; n < NAME_N; n++) {
        low[n] = s->x[n] - ahead * f[n];
        high[n] = s->x[n] + ahead * f[n];
        moved[n] = s->x[n];
    }
    for (int e = 0; e < NAME_EDGES; e++) {
        if (NAME_source[e] != s->mode) continue;
        double value = NAME_value(s, in, e, s->t, s->x), band = 0.0;
        for (int n = 0; n < NAME_N; n++) {
            double shift = 1e-7 * (fabs(s->x[n]) + NAME_size[n]);
            double change = HUGE_VAL;  /* the less of both sides: a condition may jump on one */
            for (int side = -1; side <= 1; side += 2) {
                moved[n] = s->x[n] + side * shift;
                change = fmin(change, fabs(NAME_value(s, in, e, s->t, moved) - value));
            }
            band += change / shift * (fabs(s->x[n]) + fabs(f[n] * s->t));
            moved[n] = s->x[n];
        }
        band = 8 * DBL_EPSILON * (band + fabs(s->t));
        double before = NAME_value(s, in, e, s->t - ahead, low);
        double after = NAME_value(s, in, e, s->t + ahead, high);
        s->band[e] = band;
        s->armed[e] = value < -band || (value <= band && after > before && after > 0.0);
    }
}

static void NAME_take(NAME_state *s, const NAME_inputs *in, int edge)
{
    double u[NAME_U], x[NAME_N];
    NAME_at(in, s->t, u);
    NAME_reset(edge, s->x, u, s->t - s->entered, s->t, x);
    memcpy(s->x, x, sizeof x);
    s->mode = NAME_target[edge];
    s->entered = s->t;
    NAME_arm(s, in);
}

/* Takes what is due at the present instant, one after the other; 1 if something was. */
static int NAME_settle(NAME_state *s, const NAME_inputs *in)
{
    for (int count = 0; count <= 8 * (NAME_EDGES + 1); count++) {
        int due = -1;
        for (int e = 0; e < NAME_EDGES && due < 0; e++) {
            if (NAME_source[e] != s->mode) continue;
            double value = NAME_value(s, in, e, s->t, s->x);
            if (NAME_fires(s, e, value + (s->armed[e] ? s->band[e] : 0.0))) due = e;
        }
        if (due < 0) return count > 0;
        NAME_take(s, in, due);
    }
    return -1;
}

/* The mode of the model. */
int NAME_mode(const NAME_state *s) { return NAME_label[s->mode]; }

/* Starts at a state, in a mode of the model or, where that is negative, in the one that the state
   tells. Returns 0, or -1 where there is no such mode. */
int NAME_begin(NAME_state *s, double t, const double *x, const double *u, int label)
{
    NAME_inputs in = {t, t, u, u};
    memset(s, 0, sizeof *s);
    s->t = s->entered = t;
    s->rtol = 1e-11;
    memcpy(s->x, x, sizeof s->x);
    s->mode = NAME_start(x, u, t, label);
    if (s->mode < 0) return -1;
    NAME_arm(s, &in);
    return NAME_settle(s, &in) < 0 ? -1 : 0;
}

/* Goes on to t1 along inputs that are linear from u0 at t0 to u1 at t1 (the same for held ones).
   Returns 0 at t1; 1 at an event before, where s tells the instant and what is behind it: call
   again to go on; -1 where events follow each other at one instant without end, -2 where no step is
   small enough. */
int NAME_step(NAME_state *s, double t0, const double *u0, double t1, const double *u1)
{
    NAME_inputs in = {t0, t1, u0, u1};
    double k[7][NAME_N], y[NAME_N], z[NAME_N];
    enum { parts = 8 };
    int settled = NAME_settle(s, &in);
    if (settled) return settled;
    while (s->t < t1) {
        int last = !(s->h > 0.0) || s->t + s->h * (1 + 1e-12) >= t1;
        double h = last ? t1 - s->t : s->h, error = NAME_rk(s, &in, h, y, k);
        double scale = error > 0.0 ? fmin(5.0, fmax(0.2, 0.9 * pow(error, -0.2))) : 5.0;
        if (!(error <= 1.0)) {
            s->h = error >= 0.0 ? h * fmin(scale, 0.9) : 0.1 * h;
            if (s->h <= 4 * DBL_EPSILON * fabs(s->t)) return -2;
            continue;
        }
        double low = 0.0, high = -1.0;
        for (int p = 1; p <= parts && high < 0.0; p++) {
            double q = (double)p / parts;
            for (int n = 0; n < NAME_N; n++)  /* Hermite's cubic between both ends */
                z[n] = (1 - q) * s->x[n] + q * y[n] + q * (q - 1) * ((1 - 2 * q) * (y[n] - s->x[n])
                       + h * ((q - 1) * k[0][n] + q * k[6][n]));
            for (int e = 0; e < NAME_EDGES; e++) {
                if (NAME_source[e] != s->mode) continue;
                double value = NAME_value(s, &in, e, s->t + q * h, p < parts ? z : y);
                if (!NAME_fires(s, e, value)) {
                    if (value < -s->band[e]) s->armed[e] = 1;
                    continue;
                }
                if (p < parts) {  /* is it so without the error of the cubic? */
                    double w[NAME_N], l[7][NAME_N];
                    NAME_rk(s, &in, q * h, w, l);
                    if (!NAME_fires(s, e, NAME_value(s, &in, e, s->t + q * h, w))) continue;
                }
                high = q;
            }
            if (high < 0.0) low = q;
        }
        if (high < 0.0) {
            s->t = last ? t1 : s->t + h;
            memcpy(s->x, y, sizeof y);
            if (!last || scale < 1.0 || !(s->h > 0.0)) s->h = h * scale;
            continue;
        }
        while (s->t + low * h < s->t + high * h) {  /* to the last digit of the time */
            double middle = (low + high) / 2;
            int fired = 0;
            if (s->t + middle * h <= s->t + low * h || s->t + middle * h >= s->t + high * h) break;
            NAME_rk(s, &in, middle * h, y, k);
            for (int e = 0; e < NAME_EDGES; e++)
                if (NAME_source[e] == s->mode
                    && NAME_fires(s, e, NAME_value(s, &in, e, s->t + middle * h, y))) fired = 1;
            if (fired) high = middle; else low = middle;
        }
        double soon = high * h + 1e-6 * h;  /* of guards that are zero at once, one that goes on */
        int taken = -1;
        NAME_rk(s, &in, high * h, y, k);
        NAME_rk(s, &in, soon, z, k);
        for (int e = 0, sure = 0; e < NAME_EDGES && !sure; e++) {
            if (NAME_source[e] != s->mode
                || !NAME_fires(s, e, NAME_value(s, &in, e, s->t + high * h, y))) continue;
            sure = NAME_fires(s, e, NAME_value(s, &in, e, s->t + soon, z));
            if (sure || taken < 0) taken = e;
        }
        s->t += high * h;
        memcpy(s->x, y, sizeof y);
        if (taken >= 0) {
            NAME_take(s, &in, taken);
            return NAME_settle(s, &in) < 0 ? -1 : 1;
        }
    }
    return 0;
}
"""

DISCRETE = r"""
typedef struct {
    double t, entered;     /* the row, and that at which the mode was entered */
    int mode;
    double x[NAME_N];
    double lately[NAME_E]; /* values of the guards a row before */
    int begun;
} NAME_state;

/* The mode of the model. */
int NAME_mode(const NAME_state *s) { return NAME_label[s->mode]; }

/* Starts at a state; the first row is 0. Returns 0, or -1 where there is no such mode. */
int NAME_begin(NAME_state *s, const double *x, const double *u, int label)
{
    memset(s, 0, sizeof *s);
    memcpy(s->x, x, sizeof s->x);
    s->mode = NAME_start(x, u, 0.0, label);
    return s->mode < 0 ? -1 : 0;
}

/* Takes the transition of this row, if there is one; returns 1 if so. s->x and s->mode are then
   those of the row. */
int NAME_row(NAME_state *s, const double *u)
{
    for (int e = 0; e < NAME_EDGES; e++) {
        if (NAME_source[e] != s->mode) continue;
        if (NAME_guard(e, s->x, u, s->t - s->entered, s->t) < 0.0) continue;
        if (NAME_target[e] == s->mode && !(s->begun && s->lately[e] < 0.0)) continue;
        double x[NAME_N];
        NAME_reset(e, s->x, u, s->t - s->entered, s->t, x);
        memcpy(s->x, x, sizeof x);
        s->mode = NAME_target[e];
        s->entered = s->t;
        return 1;
    }
    return 0;
}

/* Makes the next row of this one. */
void NAME_step(NAME_state *s, const double *u)
{
    double x[NAME_N];
    for (int e = 0; e < NAME_EDGES; e++)
        s->lately[e] = NAME_guard(e, s->x, u, s->t - s->entered, s->t);
    NAME_rhs(s->mode, s->x, u, s->t, x);
    memcpy(s->x, x, sizeof x);
    s->t += 1.0;
    s->begun = 1;
}
"""
