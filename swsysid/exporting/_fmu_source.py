"""What the source of a unit has beside its formulas: events, and the interface of FMI 2 and 3.

The names that begin with ``NAME`` are replaced by that of the model.
"""

from swsysid.exporting._fmi3_source import FMI3

EVENTS = r"""
typedef struct {
    double t, entered, x[NAME_N], u[NAME_U], shift[NAME_E];
    int mode, asked, armed[NAME_E], begun;  /* asked: the mode of the model to start in, -1 any */
    double start[NAME_N];
} NAME_unit;

static double NAME_value(const NAME_unit *m, int edge)
{
    return NAME_guard(edge, m->x, m->u, m->t - m->entered, m->t);
}

static double NAME_ahead(const NAME_unit *m, int edge, const double *f, double step)
{
    double x[NAME_N];
    for (int n = 0; n < NAME_N; n++) x[n] = m->x[n] + step * f[n];
    return NAME_guard(edge, x, m->u, m->t + step - m->entered, m->t + step);
}

/* An indicator is a guard less a shift until it has fired, and plus the shift from then on until
   it has fallen below zero again: it is never zero where the integration starts anew. */
static void NAME_enter(NAME_unit *m)
{
    double f[NAME_N] = {0};
    NAME_rhs(m->mode, m->x, m->u, m->t, f);
    for (int e = 0; e < NAME_EDGES; e++) {
        if (NAME_source[e] != m->mode) continue;
        double value = NAME_value(m, e), size = 0.0, x[NAME_N];
        memcpy(x, m->x, sizeof x);
        for (int n = 0; n < NAME_STATES; n++) {
            double step = 1e-6 * (fabs(x[n]) + NAME_size[n]);
            double change = HUGE_VAL;  /* the less of both sides: a condition may jump on one */
            for (int side = -1; side <= 1; side += 2) {
                x[n] = m->x[n] + side * step;
                double there = NAME_guard(e, x, m->u, m->t - m->entered, m->t);
                change = fmin(change, fabs(there - value));
            }
            size += change / step * (NAME_size[n] + fabs(m->x[n]));
            x[n] = m->x[n];
        }
        m->shift[e] = fmax(1e-10 * size, 1e-12 * (1.0 + fabs(m->t)));
        int rises = NAME_ahead(m, e, f, 1e-6) > NAME_ahead(m, e, f, -1e-6);
        m->armed[e] = value < -m->shift[e] || rises || value > 1e4 * m->shift[e];
    }
}

static void NAME_settle(NAME_unit *m)
{
    for (int count = 0; count <= 8 * (NAME_EDGES + 1); count++) {
        int due = -1;
        for (int e = 0; e < NAME_EDGES && due < 0; e++) {
            if (NAME_source[e] != m->mode) continue;
            double value = NAME_value(m, e);
            if (m->armed[e] && value >= 0.0) due = e;
            if (!m->armed[e] && value < -m->shift[e]) m->armed[e] = 1;
        }
        if (due < 0) return;
        double x[NAME_N];
        NAME_reset(due, m->x, m->u, m->t - m->entered, m->t, x);
        memcpy(m->x, x, NAME_STATES * sizeof *x);
        m->mode = NAME_target[due];
        m->entered = m->t;
        NAME_enter(m);
    }
}

static double NAME_indicator(const NAME_unit *m, int e)
{
    if (NAME_source[e] != m->mode) return -1.0;
    return NAME_value(m, e) + (m->armed[e] ? -m->shift[e] : m->shift[e]);
}

static void NAME_anew(NAME_unit *m)
{
    memset(m, 0, sizeof *m);
    memcpy(m->x, NAME_origin, NAME_STATES * sizeof *m->x);
    m->asked = NAME_first;
}

static int NAME_begin(NAME_unit *m)
{
    m->mode = NAME_start(m->x, m->u, m->t, m->asked);
    if (m->mode < 0) return -1;
    m->entered = m->t;
    m->begun = 1;
    NAME_enter(m);
    return 0;
}

static int NAME_mode_now(const NAME_unit *m)
{
    return m->begun ? m->mode : NAME_start(m->x, m->u, m->t, m->asked);
}

static double *NAME_place(NAME_unit *m, unsigned vr)
{
    if (vr < NAME_STATES) return m->x + vr;
    vr -= 2 * NAME_STATES;
    return vr < NAME_INPUTS ? m->u + vr : NULL;
}
"""

# What both versions have, in the names of FMI 3.
_BOTH = r"""
const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String names[])
{
    (void)c; (void)on; (void)n; (void)names;
    return fmi3OK;
}

void fmi3FreeInstance(fmi3Instance c) { free(c); }

fmi3Status fmi3ExitInitializationMode(fmi3Instance c)
{
    return NAME_begin(c) ? fmi3Error : fmi3OK;
}

#define NOTHING(what) fmi3Status fmi3##what(fmi3Instance c) { (void)c; return fmi3OK; }
NOTHING(EnterEventMode)
NOTHING(EnterContinuousTimeMode)
NOTHING(Terminate)

fmi3Status fmi3Reset(fmi3Instance c)
{
    NAME_anew(c);
    return fmi3OK;
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance c, fmi3Boolean last, fmi3Boolean *enter,
                                       fmi3Boolean *stop)
{
    (void)c; (void)last;
    *enter = *stop = fmi3False;
    return fmi3OK;
}

fmi3Status fmi3SetTime(fmi3Instance c, fmi3Float64 t) { ((NAME_unit *)c)->t = t; return fmi3OK; }

fmi3Status fmi3SetContinuousStates(fmi3Instance c, const fmi3Float64 x[], size_t n)
{
    memcpy(((NAME_unit *)c)->x, x, n * sizeof *x);
    return fmi3OK;
}

fmi3Status fmi3GetContinuousStates(fmi3Instance c, fmi3Float64 x[], size_t n)
{
    memcpy(x, ((NAME_unit *)c)->x, n * sizeof *x);
    return fmi3OK;
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance c, fmi3Float64 dx[], size_t n)
{
    NAME_unit *m = c;
    (void)n;
    NAME_rhs(m->mode, m->x, m->u, m->t, dx);
    return fmi3OK;
}

fmi3Status fmi3GetEventIndicators(fmi3Instance c, fmi3Float64 z[], size_t n)
{
    for (size_t e = 0; e < n; e++) z[e] = NAME_indicator(c, (int)e);
    return fmi3OK;
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance c, fmi3Float64 x[], size_t n)
{
    (void)c;
    memcpy(x, NAME_size, n * sizeof *x);
    return fmi3OK;
}

fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *s)
{
    if (!*s) *s = malloc(sizeof(NAME_unit));
    if (!*s) return fmi3Error;
    memcpy(*s, c, sizeof(NAME_unit));
    return fmi3OK;
}

fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState s)
{
    memcpy(c, s, sizeof(NAME_unit));
    return fmi3OK;
}

fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *s)
{
    (void)c;
    free(*s);
    *s = NULL;
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState s, size_t *n)
{
    (void)c; (void)s;
    *n = sizeof(NAME_unit);
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState s, fmi3Byte b[], size_t n)
{
    (void)c;
    memcpy(b, s, n);
    return fmi3OK;
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte b[], size_t n, fmi3FMUState *s)
{
    fmi3Status done = fmi3GetFMUState(c, s);
    if (done == fmi3OK) memcpy(*s, b, n);
    return done;
}
"""

_NAMES_OF_2 = {
    "fmi3Instance": "fmi2Component",
    "fmi3Float64": "fmi2Real",
    "GetContinuousStateDerivatives": "GetDerivatives",
    "FMUState": "FMUstate",
    "Deserialize": "DeSerialize",
    "fmi3": "fmi2",
}

_FMI2 = r"""
const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String place,
                              const fmi2CallbackFunctions *calls, fmi2Boolean seen, fmi2Boolean log)
{
    (void)name; (void)place; (void)calls; (void)seen; (void)log;
    if (type != fmi2ModelExchange || strcmp(guid, NAME_GUID)) return NULL;
    NAME_unit *m = calloc(1, sizeof *m);
    if (m) fmi2Reset(m);
    return m;
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance,
                               fmi2Real start, fmi2Boolean has_stop, fmi2Real stop)
{
    (void)has_tolerance; (void)tolerance; (void)has_stop; (void)stop;
    ((NAME_unit *)c)->t = start;
    return fmi2OK;
}

NOTHING(EnterInitializationMode)

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info)
{
    NAME_unit *m = c;
    double before[NAME_N];
    memcpy(before, m->x, sizeof before);
    NAME_settle(m);
    info->newDiscreteStatesNeeded = fmi2False;
    info->terminateSimulation = fmi2False;
    info->nominalsOfContinuousStatesChanged = fmi2False;
    info->valuesOfContinuousStatesChanged = memcmp(before, m->x, sizeof before) != 0;
    info->nextEventTimeDefined = fmi2False;
    info->nextEventTime = 0.0;
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    NAME_unit *m = c;
    for (size_t k = 0; k < n; k++) {
        const double *place = NAME_place(m, vr[k]);
        double dx[NAME_N] = {0};
        if (place) { value[k] = *place; continue; }
        if (vr[k] >= 2 * NAME_STATES) return fmi2Error;
        NAME_rhs(NAME_mode_now(m), m->x, m->u, m->t, dx);
        value[k] = dx[vr[k] - NAME_STATES];
    }
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                       const fmi2Real value[])
{
    for (size_t k = 0; k < n; k++) {
        double *place = NAME_place(c, vr[k]);
        if (!place) return fmi2Error;
        *place = value[k];
    }
    return fmi2OK;
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                          fmi2Integer value[])
{
    NAME_unit *m = c;
    int mode = NAME_mode_now(m);
    for (size_t k = 0; k < n; k++)
        value[k] = vr[k] == NAME_ASKED ? m->asked : mode < 0 ? -1
                   : vr[k] == NAME_ASKED + 1 ? NAME_label[mode] : mode;
    return fmi2OK;
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                          const fmi2Integer value[])
{
    for (size_t k = 0; k < n; k++) {
        if (vr[k] != NAME_ASKED) return fmi2Error;
        ((NAME_unit *)c)->asked = value[k];
    }
    return fmi2OK;
}

#define NONE(what, type)                                                                          \
    fmi2Status fmi2Get##what(fmi2Component c, const fmi2ValueReference vr[], size_t n, type v[])   \
    { (void)c; (void)vr; (void)v; return n ? fmi2Error : fmi2OK; }                                 \
    fmi2Status fmi2Set##what(fmi2Component c, const fmi2ValueReference vr[], size_t n,             \
                             const type v[])                                                       \
    { (void)c; (void)vr; (void)v; return n ? fmi2Error : fmi2OK; }

NONE(Boolean, fmi2Boolean)
NONE(String, fmi2String)

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference y[], size_t n,
                                        const fmi2ValueReference x[], size_t m,
                                        const fmi2Real dx[], fmi2Real dy[])
{
    (void)c; (void)y; (void)n; (void)x; (void)m; (void)dx; (void)dy;
    return fmi2Error;
}
"""


def _named_as_in_2(source: str) -> str:
    for new, old in _NAMES_OF_2.items():
        source = source.replace(new, old)
    return source


INTERFACES = {2: _named_as_in_2(_BOTH) + _FMI2, 3: _BOTH + FMI3}
