"""What FMI 3 has and FMI 2 has not; the names that begin with ``NAME`` are the model's."""

FMI3 = r"""
#define NAME_TIME (NAME_ASKED + 3)  /* after it the indicators, as variables */

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String place,
                                          fmi3Boolean seen, fmi3Boolean log,
                                          fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback message)
{
    (void)name; (void)place; (void)seen; (void)log; (void)environment; (void)message;
    if (strcmp(token, NAME_GUID)) return NULL;
    NAME_unit *m = calloc(1, sizeof *m);
    if (m) NAME_anew(m);
    return m;
}

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String place, fmi3Boolean seen, fmi3Boolean log,
    fmi3Boolean events, fmi3Boolean early, const fmi3ValueReference needed[], size_t n,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback message,
    fmi3IntermediateUpdateCallback update)
{
    (void)name; (void)token; (void)place; (void)seen; (void)log; (void)events; (void)early;
    (void)needed; (void)n; (void)environment; (void)message; (void)update;
    return NULL;
}

fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String name, fmi3String token, fmi3String place, fmi3Boolean seen, fmi3Boolean log,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback message,
    fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,
    fmi3UnlockPreemptionCallback unlock)
{
    (void)name; (void)token; (void)place; (void)seen; (void)log; (void)environment;
    (void)message; (void)update; (void)lock; (void)unlock;
    return NULL;
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean has_tolerance,
                                       fmi3Float64 tolerance, fmi3Float64 start,
                                       fmi3Boolean has_stop, fmi3Float64 stop)
{
    (void)has_tolerance; (void)tolerance; (void)has_stop; (void)stop;
    ((NAME_unit *)c)->t = start;
    return fmi3OK;
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *again, fmi3Boolean *stop,
                                    fmi3Boolean *nominals, fmi3Boolean *values,
                                    fmi3Boolean *timed, fmi3Float64 *next)
{
    NAME_unit *m = c;
    double before[NAME_N];
    memcpy(before, m->x, sizeof before);
    NAME_settle(m);
    *again = *stop = *nominals = *timed = fmi3False;
    *values = memcmp(before, m->x, sizeof before) != 0;
    *next = 0.0;
    return fmi3OK;
}

NOTHING(EvaluateDiscreteStates)
NOTHING(EnterConfigurationMode)
NOTHING(ExitConfigurationMode)

#define REFUSED(what) fmi3Status fmi3##what(fmi3Instance c) { (void)c; return fmi3Error; }
REFUSED(EnterStepMode)

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance c, size_t *n)
{
    (void)c;
    *n = NAME_EDGES;
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance c, size_t *n)
{
    (void)c;
    *n = NAME_STATES;
    return fmi3OK;
}

fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                          fmi3Float64 value[], size_t count)
{
    NAME_unit *m = c;
    (void)count;
    for (size_t k = 0; k < n; k++) {
        double *place = NAME_place(m, vr[k]);
        double dx[NAME_N] = {0};
        if (place) value[k] = *place;
        else if (vr[k] == NAME_TIME) value[k] = m->t;
        else if (vr[k] > NAME_TIME && vr[k] <= NAME_TIME + NAME_EDGES)
            value[k] = NAME_indicator(m, (int)(vr[k] - NAME_TIME - 1));
        else if (vr[k] < 2 * NAME_STATES) {
            NAME_rhs(NAME_mode_now(m), m->x, m->u, m->t, dx);
            value[k] = dx[vr[k] - NAME_STATES];
        } else return fmi3Error;
    }
    return fmi3OK;
}

fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                          const fmi3Float64 value[], size_t count)
{
    (void)count;
    for (size_t k = 0; k < n; k++) {
        double *place = NAME_place(c, vr[k]);
        if (!place) return fmi3Error;
        *place = value[k];
    }
    return fmi3OK;
}

fmi3Status fmi3GetInt32(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                        fmi3Int32 value[], size_t count)
{
    NAME_unit *m = c;
    int mode = NAME_mode_now(m);
    (void)count;
    for (size_t k = 0; k < n; k++)
        value[k] = vr[k] == NAME_ASKED ? m->asked : mode < 0 ? -1
                   : vr[k] == NAME_ASKED + 1 ? NAME_label[mode] : mode;
    return fmi3OK;
}

fmi3Status fmi3SetInt32(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                        const fmi3Int32 value[], size_t count)
{
    (void)count;
    for (size_t k = 0; k < n; k++) {
        if (vr[k] != NAME_ASKED) return fmi3Error;
        ((NAME_unit *)c)->asked = value[k];
    }
    return fmi3OK;
}

#define NONE(what)                                                                                 \
    fmi3Status fmi3Get##what(fmi3Instance c, const fmi3ValueReference vr[], size_t n,              \
                             fmi3##what v[], size_t m)                                             \
    { (void)c; (void)vr; (void)v; (void)m; return n ? fmi3Error : fmi3OK; }                        \
    fmi3Status fmi3Set##what(fmi3Instance c, const fmi3ValueReference vr[], size_t n,              \
                             const fmi3##what v[], size_t m)                                       \
    { (void)c; (void)vr; (void)v; (void)m; return n ? fmi3Error : fmi3OK; }

NONE(Float32) NONE(Int8) NONE(UInt8) NONE(Int16) NONE(UInt16) NONE(UInt32) NONE(Int64)
NONE(UInt64) NONE(Boolean) NONE(String)

fmi3Status fmi3GetBinary(fmi3Instance c, const fmi3ValueReference vr[], size_t n, size_t sizes[],
                         fmi3Binary v[], size_t m)
{ (void)c; (void)vr; (void)sizes; (void)v; (void)m; return n ? fmi3Error : fmi3OK; }

fmi3Status fmi3SetBinary(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                         const size_t sizes[], const fmi3Binary v[], size_t m)
{ (void)c; (void)vr; (void)sizes; (void)v; (void)m; return n ? fmi3Error : fmi3OK; }

fmi3Status fmi3GetClock(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Clock v[])
{ (void)c; (void)vr; (void)v; return n ? fmi3Error : fmi3OK; }

fmi3Status fmi3SetClock(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                        const fmi3Clock v[])
{ (void)c; (void)vr; (void)v; return n ? fmi3Error : fmi3OK; }

/* what no unit of this kind has */

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance c, fmi3ValueReference vr, size_t *n)
{ (void)c; (void)vr; *n = 0; return fmi3Error; }

fmi3Status fmi3GetVariableDependencies(fmi3Instance c, fmi3ValueReference vr, size_t a[],
                                       fmi3ValueReference b[], size_t d[], fmi3DependencyKind e[],
                                       size_t n)
{ (void)c; (void)vr; (void)a; (void)b; (void)d; (void)e; (void)n; return fmi3Error; }

#define DERIVATIVE(what)                                                                           \
    fmi3Status fmi3Get##what##Derivative(                                                          \
        fmi3Instance c, const fmi3ValueReference y[], size_t n, const fmi3ValueReference x[],      \
        size_t m, const fmi3Float64 seed[], size_t k, fmi3Float64 out[], size_t l)                 \
    { (void)c; (void)y; (void)n; (void)x; (void)m; (void)seed; (void)k; (void)out; (void)l;        \
      return fmi3Error; }

DERIVATIVE(Directional) DERIVATIVE(Adjoint)

#define OF_CLOCKS(what, first, second)                                                             \
    fmi3Status fmi3##what(fmi3Instance c, const fmi3ValueReference vr[], size_t n, first a[],      \
                          second b[])                                                              \
    { (void)c; (void)vr; (void)a; (void)b; return n ? fmi3Error : fmi3OK; }

OF_CLOCKS(GetIntervalDecimal, fmi3Float64, fmi3IntervalQualifier)
OF_CLOCKS(GetShiftFraction, fmi3UInt64, fmi3UInt64)
OF_CLOCKS(SetIntervalFraction, const fmi3UInt64, const fmi3UInt64)
OF_CLOCKS(SetShiftFraction, const fmi3UInt64, const fmi3UInt64)

#define OF_CLOCK(what, type)                                                                       \
    fmi3Status fmi3##what(fmi3Instance c, const fmi3ValueReference vr[], size_t n, type a[])       \
    { (void)c; (void)vr; (void)a; return n ? fmi3Error : fmi3OK; }

OF_CLOCK(GetShiftDecimal, fmi3Float64)
OF_CLOCK(SetIntervalDecimal, const fmi3Float64)
OF_CLOCK(SetShiftDecimal, const fmi3Float64)

fmi3Status fmi3GetIntervalFraction(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                                   fmi3UInt64 a[], fmi3UInt64 b[], fmi3IntervalQualifier q[])
{ (void)c; (void)vr; (void)a; (void)b; (void)q; return n ? fmi3Error : fmi3OK; }

fmi3Status fmi3GetOutputDerivatives(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                                    const fmi3Int32 order[], fmi3Float64 value[], size_t m)
{ (void)c; (void)vr; (void)n; (void)order; (void)value; (void)m; return fmi3Error; }

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 t, fmi3Float64 h, fmi3Boolean last,
                      fmi3Boolean *event, fmi3Boolean *stop, fmi3Boolean *early, fmi3Float64 *done)
{ (void)c; (void)t; (void)h; (void)last; (void)event; (void)stop; (void)early; (void)done;
  return fmi3Error; }

fmi3Status fmi3ActivateModelPartition(fmi3Instance c, fmi3ValueReference clock, fmi3Float64 t)
{ (void)c; (void)clock; (void)t; return fmi3Error; }
"""
