/* The drill in C, as one would write it straight from the paper: closed forms between collisions,
 * and the next collision by stepping a fraction of a vibration cycle, then safeguarded Newton.
 *
 * drill in_rock strides duration phase, then the 11 constants of `struct drill` in their order.
 * Prints one JSON object: statistics of the run and the processor time of the loop.
 *
 * With strides = 1 it takes longer steps while the free mass is out of the tip's reach.
 */
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#define STEPS_PER_CYCLE 16
#define AFTER 1e-8    /* s: after a collision the search begins this much later */
#define COUNTED 0.1   /* m/s: slower blows are part of a contact that lasts, and not counted */

struct drill {
    double m_ud, c_1, k_1;       /* RPUD on its load spring */
    double m_fm;                 /* free mass */
    double m_dt, c_2, k_2;       /* drill tool, before drilling or while in contact with the rock */
    double e_1, e_2;             /* restitution of actuator and drill tool */
    double W, g, A_0, f_0;       /* weight on bit, gravity, vibration */
    bool in_rock;
};

/* offset + exp(-a t) (A_1 cos(w t) + A_2 sin(w t)), eq. (8) */
struct oscillation {
    double offset, a, w, A_1, A_2;
};

struct motion {
    double u, v;
};

/* Everything between two collisions, times from its start. */
struct flight {
    double phase; /* of the vibration at the start [cycles] */
    struct oscillation np, dt;
    double u_fm, v_fm, g;
    bool together; /* free mass on the drill tool in the rock, eq. (29) */
    bool at_rest;  /* drill tool in the rock, left alone */
    const struct drill *d;
};

static struct oscillation oscillation(double m, double c, double k, double F, double u, double v)
{
    struct oscillation o;
    o.a = 0.5 * c / m;
    o.w = sqrt(k / m - o.a * o.a);
    o.offset = F / k;
    o.A_1 = u - o.offset;
    o.A_2 = (v + o.a * o.A_1) / o.w;
    return o;
}

static struct motion at(const struct oscillation *o, double t)
{
    double e = o->a == 0.0 ? 1.0 : exp(-o->a * t);
    double c = e * cos(o->w * t), s = e * sin(o->w * t);
    struct motion m = {
        o->offset + o->A_1 * c + o->A_2 * s,
        (o->w * o->A_2 - o->a * o->A_1) * c - (o->w * o->A_1 + o->a * o->A_2) * s,
    };
    return m;
}

static struct motion vibration(const struct flight *f, double t)
{
    double angle = 2.0 * M_PI * (f->phase + f->d->f_0 * t);
    struct motion m = {
        f->d->A_0 * sin(angle), 2.0 * M_PI * f->d->f_0 * f->d->A_0 * cos(angle)
    };
    return m;
}

static struct motion tool_at(const struct flight *f, double t)
{
    struct motion rest = {0.0, 0.0};
    return f->at_rest ? rest : at(&f->dt, t);
}

static struct motion mass_at(const struct flight *f, double t)
{
    if (f->together)
        return at(&f->dt, t);
    struct motion m = {f->u_fm + f->v_fm * t + 0.5 * f->g * t * t, f->v_fm + f->g * t};
    return m;
}

/* Gap between actuator and free mass, with its slope. */
static struct motion tip_gap(const struct flight *f, double t)
{
    struct motion np = at(&f->np, t), hv = vibration(f, t), fm = mass_at(f, t);
    struct motion gap = {fm.u - np.u - hv.u, fm.v - np.v - hv.v};
    return gap;
}

/* Gap between free mass and drill tool, with its slope. */
static struct motion tool_gap(const struct flight *f, double t)
{
    struct motion dt = tool_at(f, t), fm = mass_at(f, t);
    struct motion gap = {dt.u - fm.u, dt.v - fm.v};
    return gap;
}

typedef struct motion gap_function(const struct flight *, double);

/* Root in a bracket whose left end is positive and right end is not: Newton, else bisection. */
static double root(gap_function *gap, const struct flight *f, double left, double right)
{
    double t = 0.5 * (left + right);
    for (int i = 0; i < 100; i++) {
        struct motion m = gap(f, t);
        if (m.u > 0.0)
            left = t;
        else
            right = t;
        double next = t - m.u / m.v;
        if (!(next > left && next < right))
            next = 0.5 * (left + right);
        if (fabs(next - t) < 1e-15)
            return next;
        t = next;
    }
    return t;
}

/* Time of the first root in a step, or INFINITY; the gaps at both ends are known. */
static double root_in_step(
    gap_function *gap, const struct flight *f, double left, double right, struct motion at_left,
    struct motion at_right)
{
    if (at_right.u <= 0.0)
        return at_left.u > 0.0 ? root(gap, f, left, right) : left;
    if (!(at_left.v < 0.0 && at_right.v > 0.0))
        return INFINITY;
    /* It has a minimum in between, which may lie below zero. */
    double a = left, b = right;
    while (b - a > 1e-12) {
        double middle = 0.5 * (a + b);
        struct motion m = gap(f, middle);
        if (m.u <= 0.0)
            return root(gap, f, left, middle);
        if (m.v < 0.0)
            a = middle;
        else
            b = middle;
    }
    return INFINITY;
}

enum event { TIP, TOOL, RELEASE, END };

/* When the contact force returns to zero, after eq. (39). */
static double release_time(const struct flight *f)
{
    double w = f->dt.w, amplitude = hypot(f->dt.A_1, f->dt.A_2);
    if (!(w * w * amplitude > f->g))
        return INFINITY;
    return (acos(-f->g / (w * w * amplitude)) - atan2(-f->dt.A_2, f->dt.A_1)) / w;
}

static double next_event(const struct flight *f, double limit, bool strides, enum event *event)
{
    const struct drill *d = f->d;
    double h = 1.0 / (STEPS_PER_CYCLE * d->f_0);
    double end = limit;
    *event = END;
    if (f->together) {
        double release = release_time(f);
        if (release < end) {
            end = release;
            *event = RELEASE;
        }
    } else if (f->at_rest) {
        double fall = (sqrt(f->v_fm * f->v_fm - 2.0 * f->g * f->u_fm) - f->v_fm) / f->g;
        if (fall < end) {
            end = fall;
            *event = TOOL;
        }
    }
    bool search_tool = !f->together && !f->at_rest;
    double t = AFTER;
    struct motion tip = tip_gap(f, t), tool = {1.0, 0.0};
    if (search_tool)
        tool = tool_gap(f, t);
    while (t < end) {
        double step = h;
        if (strides) {
            struct motion np = at(&f->np, t), fm = mass_at(f, t);
            double reach = fm.u - np.u - d->A_0;
            step = fmax(step, 0.5 * reach / (fabs(fm.v - np.v) + 1.0));
        }
        double after = fmin(t + step, end), first = INFINITY;
        struct motion tip_after = tip_gap(f, after), tool_after = tool;
        enum event what = TIP;
        if (step == h || tip_after.u <= 0.0)
            first = root_in_step(tip_gap, f, t, after, tip, tip_after);
        if (search_tool) {
            tool_after = tool_gap(f, after);
            double second = root_in_step(tool_gap, f, t, after, tool, tool_after);
            if (second < first) {
                first = second;
                what = TOOL;
            }
        }
        if (first <= after) {
            *event = what;
            return first;
        }
        t = after;
        tip = tip_after;
        tool = tool_after;
    }
    return end;
}

static void collide(double m_1, double *v_1, double m_2, double *v_2, double e)
{
    double total = m_1 + m_2, a = *v_1, b = *v_2;
    *v_1 = ((m_1 - e * m_2) * a + (1.0 + e) * m_2 * b) / total;
    *v_2 = ((m_2 - e * m_1) * b + (1.0 + e) * m_1 * a) / total;
}

struct statistics {
    double tip_impacts, tool_impacts, speed, force, energy, reacting_impulse;
};

/* Greatest force of a contact that lasts for a time, eqs. (30), (36) and (38). */
static double peak_force(const struct drill *d, const struct oscillation *o, double duration)
{
    double angle = atan2(o->A_2, o->A_1), square = o->w * o->w;
    if (angle < 0.0)
        angle += 2.0 * M_PI;
    if (angle < o->w * duration)
        return d->m_fm * (d->g + square * hypot(o->A_1, o->A_2));
    double end = at(o, duration).u - o->offset;
    return d->m_fm * (d->g + square * fmax(o->A_1, end));
}

/* Integral of W - k_1 u_np - c_1 v_np over a flight, from eq. (2). */
static double reacting_impulse(const struct drill *d, const struct flight *f, double t)
{
    const struct oscillation *o = &f->np;
    struct motion start = at(o, 0.0), end = at(o, t);
    double change = end.v - start.v + 2.0 * o->a * (end.u - start.u);
    double position = o->offset * t - change / (o->a * o->a + o->w * o->w);
    return d->W * t - d->k_1 * position - d->c_1 * (end.u - start.u);
}

static struct statistics run(const struct drill *d, double duration, double phase, bool strides)
{
    struct statistics s = {0};
    struct flight f = {.d = d, .phase = phase, .g = d->g};
    struct motion np = {-d->A_0 * sin(2.0 * M_PI * phase), 0.0}, fm = {0}, dt = {0};
    double time = 0.0;
    double force = 0.0; /* of the contact in progress */
    enum event event = TOOL; /* every gap is closed at the start */
    bool all_closed = true, together = false, at_rest = d->in_rock;
    while (time < duration) {
        /* Collisions: the pair that met, then whoever touches behind it. */
        struct motion hv = vibration(&f, 0.0);
        bool tip_closed = event == TIP || all_closed;
        bool tool_closed = event == TOOL || together || all_closed;
        bool tool_struck = false, counted = false;
        if (tip_closed && np.v + hv.v > fm.v + COUNTED)
            s.tip_impacts += 1.0;
        for (int i = 0; i < 1000; i++) {
            double v_ut = np.v + hv.v;
            bool done = true;
            if (tip_closed && v_ut > fm.v + 1e-9) {
                collide(d->m_ud, &v_ut, d->m_fm, &fm.v, d->e_1);
                np.v = v_ut - hv.v;
                done = false;
            }
            if (tool_closed && fm.v > dt.v + 1e-9) {
                if (!tool_struck && fm.v > dt.v + COUNTED) {
                    counted = true;
                    s.tool_impacts += 1.0;
                    s.speed += fm.v - dt.v;
                    s.energy += 0.5 * d->m_fm * fm.v * fm.v;
                }
                tool_struck = true;
                collide(d->m_fm, &fm.v, d->m_dt, &dt.v, d->in_rock ? 0.0 : d->e_2);
                done = false;
            }
            if (done)
                break;
        }
        if (d->in_rock) {
            if (counted || event == RELEASE) {
                s.force += force;
                force = 0.0;
            }
            together = tool_struck || all_closed || (together && event != RELEASE);
            at_rest = !together;
            if (at_rest)
                dt.u = dt.v = 0.0;
        }
        all_closed = false;
        f.np = oscillation(d->m_ud, d->c_1, d->k_1, d->W, np.u, np.v);
        f.together = together;
        f.at_rest = at_rest;
        f.u_fm = fm.u;
        f.v_fm = fm.v;
        if (together)
            f.dt = oscillation(d->m_fm + d->m_dt, 0.0, d->k_2, d->m_fm * d->g, dt.u, dt.v);
        else if (!at_rest)
            f.dt = oscillation(d->m_dt, d->c_2, d->k_2, 0.0, dt.u, dt.v);

        double t = next_event(&f, duration - time, strides, &event);
        s.reacting_impulse += reacting_impulse(d, &f, t);
        if (together)
            force = fmax(force, peak_force(d, &f.dt, t));
        np = at(&f.np, t);
        fm = mass_at(&f, t);
        dt = tool_at(&f, t);
        f.phase = fmod(f.phase + d->f_0 * t, 1.0);
        time += t;
        if (event == END)
            break;
        if (event == TIP)
            fm.u = fmax(fm.u, np.u + vibration(&f, 0.0).u);
        else if (event == TOOL)
            fm.u = dt.u;
    }
    return s;
}

int main(int count, char **words)
{
    if (count != 18) {
        fprintf(stderr, "drill: expects 17 numbers\n");
        return 2;
    }
    double v[18];
    for (int i = 1; i < 18; i++)
        v[i] = atof(words[i]);
    struct drill d = {
        .in_rock = v[1] != 0.0, .m_ud = v[5], .c_1 = v[6], .k_1 = v[7], .m_fm = v[8],
        .m_dt = v[9], .c_2 = v[10], .k_2 = v[11], .e_1 = v[12], .e_2 = v[13], .W = v[14],
        .g = v[15], .A_0 = v[16], .f_0 = v[17],
    };
    struct timespec began, ended;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &began);
    struct statistics s = run(&d, v[3], v[4], v[2] != 0.0);
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &ended);
    double used = (ended.tv_sec - began.tv_sec) + 1e-9 * (ended.tv_nsec - began.tv_nsec);
    printf("{\"cpu_time\": %.9g, \"drill_tool_impact_rate\": %.9g, \"actuator_impact_rate\": %.9g, "
           "\"impact_velocity_mean\": %.9g, \"kinetic_energy_rate\": %.9g, "
           "\"contact_force_mean\": %.9g, \"reacting_force_mean\": %.9g}\n",
           used, s.tool_impacts / v[3], s.tip_impacts / v[3], s.speed / s.tool_impacts,
           s.energy / v[3], s.force / s.tool_impacts, s.reacting_impulse / v[3]);
    return 0;
}
