/* The drill in C, as fast as we can write it. It keeps statistics only.
 *
 * Between two collisions every body has a closed form. The slow ones, nodal plane and free drill
 * tool, are power series over a span in which those reach double precision; their coefficients are
 * two fixed multiples of position and velocity. The contact in the rock is solved in closed form
 * to its end, with series for the arcs where those are small. Only the tip needs a sine and cosine
 * between events.
 *
 * The next strike of the tip is found by certain steps: the gap cannot close within one. While the
 * free mass is out of the tip's reach the step bounds the slow motion alone; within reach it
 * follows from bounds on the second and third derivative, and converges as Newton's does.
 *
 * drill in_rock duration phase u_np v_np u_fm v_fm u_dt v_dt, then the 13 constants of `struct
 * drill` in their order. The free mass is in flight at first. Prints one JSON object: statistics of
 * the run, the processor time of the loop, and the times of the first impacts on the drill tool.
 */
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#define COUNTED 0.1    /* m/s: slower blows are part of a contact that lasts, and not counted */
#define SAME 1e-9      /* m/s: bodies that approach more slowly do not collide */
#define AFTER 1e-8     /* s: least step after a collision that left bodies together */
#define NEAR_ROOT 1e-9 /* s: a step that is shorter leads to the root within a picometre */
#define TIP_TERMS 11   /* of the series of the nodal plane */
#define TOOL_TERMS 17  /* of the series of the drill tool */

struct drill {
    double m_ud, c_1, k_1;       /* RPUD on its load spring */
    double m_fm;                 /* free mass */
    double m_dt, c_2, k_2;       /* drill tool, before drilling or while in contact with the rock */
    double e_1, e_2;             /* restitution of actuator and drill tool */
    double W, g, A_0, f_0;       /* weight on bit, gravity, vibration */
    bool in_rock;
};

struct motion {
    double u, v;
};

/* sin and cos of 2 pi x: one reduction to an eighth of a turn, two polynomials */
static inline struct motion turn(double x)
{
    double quarters = __builtin_rint(4.0 * x);
    double r = 2.0 * M_PI * (x - 0.25 * quarters), z = r * r;
    double s = r + r * z * (-1.0 / 6 + z * (1.0 / 120 + z * (-1.0 / 5040 + z * (1.0 / 362880
        + z * (-1.0 / 39916800 + z * (1.0 / 6227020800 - z * (1.0 / 1307674368000)))))));
    double c = 1.0 + z * (-0.5 + z * (1.0 / 24 + z * (-1.0 / 720 + z * (1.0 / 40320
        + z * (-1.0 / 3628800 + z * (1.0 / 479001600 + z * (-1.0 / 87178291200
        + z * (1.0 / 20922789888000))))))));
    int q = (int)quarters;
    double sine = q & 1 ? c : s, cosine = q & 1 ? s : c;
    struct motion m = {q & 2 ? -sine : sine, (q + 1) & 2 ? -cosine : cosine};
    return m;
}

/* Power series of x'' = -square x - 2 a x': coefficients for x = 1, x' = 0 and for x = 0, x' = 1 */
static void series(double a, double square, int terms, double *of_u, double *of_v)
{
    of_u[0] = 1.0, of_u[1] = 0.0, of_v[0] = 0.0, of_v[1] = 1.0;
    for (int n = 0; n + 2 < terms; n++) {
        double below = 1.0 / ((n + 1.0) * (n + 2.0));
        of_u[n + 2] = -(square * of_u[n] + 2.0 * a * (n + 1) * of_u[n + 1]) * below;
        of_v[n + 2] = -(square * of_v[n] + 2.0 * a * (n + 1) * of_v[n + 1]) * below;
    }
}

static inline struct motion sum(const double *c, int terms, double t)
{
    struct motion m = {c[terms - 1], 0.0};
    for (int n = terms - 2; n >= 0; n--) {
        m.v = m.v * t + m.u;
        m.u = m.u * t + c[n];
    }
    return m;
}

/* Time within which a gap g with slope v cannot close, if its second derivative is above -bound */
static inline double safe_step(double g, double v, double bound)
{
    double root = sqrt(v * v + 2.0 * bound * g);
    return v < 0.0 ? 2.0 * g / (root - v) : (v + root) / bound;
}

static inline void collide(double m_1, double *v_1, double m_2, double *v_2, double e, double whole)
{
    double a = *v_1, b = *v_2;
    *v_1 = ((m_1 - e * m_2) * a + (1.0 + e) * m_2 * b) * whole;
    *v_2 = ((m_2 - e * m_1) * b + (1.0 + e) * m_1 * a) * whole;
}

struct statistics {
    double tip_impacts, tool_impacts, speed, force, energy, reacting_impulse;
};

#define KEPT 64
static double times[KEPT]; /* of the first impacts on the drill tool */

static struct statistics run(
    const struct drill *d, double duration, double phase, struct motion np, struct motion fm,
    struct motion dt)
{
    const double omega = 2.0 * M_PI * d->f_0, A = d->A_0, g = d->g, f = d->f_0;
    const double vibration_second = omega * omega * A, vibration_third = omega * vibration_second;
    const double a_np = 0.5 * d->c_1 / d->m_ud, square_np = d->k_1 / d->m_ud;
    const double root_np = sqrt(square_np), offset_np = d->W / d->k_1;
    /* The decaying part of (u, v) is at most this times hypot(root u, v). */
    const double grows_np = 1.0 / sqrt(1.0 - a_np / root_np);
    const double a_dt = 0.5 * d->c_2 / d->m_dt, square_dt = d->k_2 / d->m_dt;
    const double root_dt = sqrt(square_dt);
    const double grows_dt = 1.0 / sqrt(1.0 - a_dt / root_dt);
    const double tip_whole = 1.0 / (d->m_ud + d->m_fm), tool_whole = 1.0 / (d->m_fm + d->m_dt);
    const double e_2 = d->in_rock ? 0.0 : d->e_2;
    /* both bodies in a contact in the rock, without damping */
    const double square_c = d->k_2 * tool_whole, w_c = sqrt(square_c), per_w_c = 1.0 / w_c;
    const double offset_c = d->m_fm * g / d->k_2, lift = g / square_c;
    /* the spans of the series: their first missing term is then below the last digit */
    double span = 0.2 / root_np;
    if (!d->in_rock && 1.0 / root_dt < span)
        span = 1.0 / root_dt;
    double np_u[TIP_TERMS], np_v[TIP_TERMS], dt_u[TOOL_TERMS], dt_v[TOOL_TERMS];
    series(a_np, square_np, TIP_TERMS, np_u, np_v);
    series(a_dt, square_dt, TOOL_TERMS, dt_u, dt_v);

    struct statistics s = {0};
    struct motion hv = turn(phase);
    const double np_start = np.v;
    double time = 0.0;
    double force = 0.0; /* of the contact in progress */
    bool tip_closed = false, tool_closed = false, together = false, released = false;
    bool at_rest = d->in_rock;
    double momentum = 0.0; /* that blows have taken from the nodal plane */
    while (time < duration) {
        /* Collisions: the pair that met, then whoever touches behind it. */
        bool tool_struck = false, counted = false;
        double v_hv = omega * A * hv.v, v_ut = np.v + v_hv;
        if (tip_closed && v_ut > fm.v + COUNTED)
            s.tip_impacts += 1.0;
        if (tip_closed | tool_closed)
            for (int i = 0; i < 1000; i++) {
                bool done = true;
                if (tip_closed && v_ut > fm.v + SAME) {
                    collide(d->m_ud, &v_ut, d->m_fm, &fm.v, d->e_1, tip_whole);
                    done = false;
                }
                if (tool_closed && fm.v > dt.v + SAME) {
                    if (!tool_struck && fm.v > dt.v + COUNTED) {
                        counted = true;
                        if (s.tool_impacts < KEPT)
                            times[(int)s.tool_impacts] = time;
                        s.tool_impacts += 1.0;
                        s.speed += fm.v - dt.v;
                        s.energy += 0.5 * d->m_fm * fm.v * fm.v;
                    }
                    tool_struck = true;
                    collide(d->m_fm, &fm.v, d->m_dt, &dt.v, e_2, tool_whole);
                    done = false;
                }
                if (done)
                    break;
            }
        momentum += v_ut - v_hv - np.v;
        np.v = v_ut - v_hv;
        if (d->in_rock) {
            if (counted | released) {
                s.force += force;
                force = 0.0;
            }
            together = tool_struck || (together && !released);
            at_rest = !together;
            if (at_rest)
                dt.u = dt.v = 0.0;
        }
        tip_closed = tool_closed = released = false;

        /* The slow motions, and the end if the tip does not strike before. */
        double end = fmin(span, duration - time);
        double from_rest = np.u - offset_np;
        double np_most = grows_np * sqrt(square_np * from_rest * from_rest + np.v * np.v);
        double np_second = root_np * np_most, np_third = square_np * np_most;
        double c_np[TIP_TERMS], c_dt[TOOL_TERMS];
        for (int n = 0; n < TIP_TERMS; n++)
            c_np[n] = np_u[n] * from_rest + np_v[n] * np.v;
        c_np[0] += offset_np;
        bool release = false, fell = false;
        double most_second = np_second, most_third = np_third;
        double from_offset = 0.0, swing = 0.0; /* of the contact */
        if (together) {
            from_offset = dt.u - offset_c;
            swing = sqrt(from_offset * from_offset + dt.v * dt.v * (per_w_c * per_w_c));
            if (swing > lift) {
                /* Its phase runs from (from_offset, v) to where it pulls by g. */
                double over = lift / swing, under = from_offset * w_c / dt.v, arc;
                if (dt.v > 0.0 && over < 1e-3 && fabs(under) < 1e-3)
                    arc = M_PI + over * (1.0 + over * over / 6.0)
                        - under * (1.0 - under * under * (1.0 / 3 - 0.2 * under * under));
                else
                    arc = acos(-over) - atan2(-dt.v, from_offset * w_c);
                if (arc * per_w_c < end) {
                    end = fmax(arc * per_w_c, 0.0);
                    release = true;
                }
            }
            most_second += square_c * swing;
            most_third += square_c * w_c * swing;
        } else {
            most_second += g;
            c_np[0] -= fm.u; /* from here on np less the free mass */
            c_np[1] -= fm.v;
            c_np[2] -= 0.5 * g;
            if (at_rest) {
                double root = sqrt(fm.v * fm.v - 2.0 * g * fm.u);
                double fall = fm.v > 0.0 ? -2.0 * fm.u / (root + fm.v) : (root - fm.v) / g;
                if (fall < end) {
                    end = fall;
                    fell = true;
                }
            } else {
                for (int n = 0; n < TOOL_TERMS; n++)
                    c_dt[n] = dt_u[n] * dt.u + dt_v[n] * dt.v;
                double most = grows_dt * sqrt(square_dt * dt.u * dt.u + dt.v * dt.v);
                double second = root_dt * most + g, t = 0.0;
                double gap = dt.u - fm.u, slope = dt.v - fm.v;
                for (int i = 0; i < 1000; i++) {
                    double step = safe_step(fmax(gap, 0.0), slope, second);
                    if (i == 0)
                        step = fmax(step, AFTER);
                    else if (slope < 0.0) {
                        double bend = 2.0 * c_dt[2] - g; /* while it stays convex, Newton's step */
                        if (bend > root_dt * root_dt * most * (t - gap / slope))
                            step = fmax(step, -gap / slope);
                    }
                    t += step;
                    if (!(t < end))
                        break;
                    if (step < NEAR_ROOT && slope < 0.0 && i > 0) {
                        end = t;
                        fell = true;
                        break;
                    }
                    struct motion at = sum(c_dt, TOOL_TERMS, t);
                    gap = at.u - (fm.u + t * (fm.v + 0.5 * g * t));
                    slope = at.v - (fm.v + g * t);
                    if (gap <= 0.0 && slope < 0.0) {
                        end = t;
                        fell = true;
                        break;
                    }
                }
            }
        }

        /* The tip. In a contact the free mass stays ahead of both its ends, so mostly nothing. */
        bool strike = false;
        double second = most_second + vibration_second, third = most_third + vibration_third;
        double ahead = fmin(dt.u, offset_c - lift) - np.u - A;
        if (!together || ahead <= (fabs(np.v) + 0.5 * np_second * end) * end || !release) {
            double t = 0.0, sine = hv.u, cosine = hv.v;
            double gap = fm.u - np.u - A * sine, slope = fm.v - np.v - omega * A * cosine;
            double slow = fm.u - np.u, slow_slope = fm.v - np.v;
            double slow_bend = (together ? g : g) + square_np * from_rest + 2.0 * a_np * np.v;
            if (together)
                slow_bend += -g - square_c * from_offset;
            bool known = true; /* the vibration at t */
            for (int i = 0; i < 2000; i++) {
                double envelope = slow - A, step = 0.0;
                if (envelope > 0.0)
                    step = safe_step(envelope, slow_slope, most_second);
                if (step * f < 0.2) { /* a fifth of a cycle: the vibration may allow more */
                    if (!known) {
                        struct motion now = turn(phase + f * t);
                        sine = now.u;
                        cosine = now.v;
                    }
                    gap = slow - A * sine;
                    slope = slow_slope - omega * A * cosine;
                    if (gap <= 0.0 && slope < 0.0 && i > 0) {
                        end = t;
                        strike = true;
                        break;
                    }
                    double value = fmax(gap, 0.0);
                    double certain = safe_step(value, slope, second);
                    double bend = slow_bend + omega * omega * A * sine;
                    if (bend > 0.0) {
                        double convex = bend / third;
                        if (slope < 0.0)
                            convex = fmin(convex, value / -slope);
                        certain = fmax(certain, convex);
                    }
                    step = fmax(step, certain);
                    if (i == 0)
                        step = fmax(step, AFTER);
                    if (step < NEAR_ROOT && slope < 0.0 && t + step < end && i > 0) {
                        end = t + step;
                        strike = true;
                        break;
                    }
                }
                t += step;
                if (!(t < end))
                    break;
                known = false;
                struct motion at = sum(c_np, TIP_TERMS, t);
                slow = -at.u;
                slow_slope = -at.v;
                if (together) {
                    struct motion w = turn(w_c * t * (0.5 / M_PI));
                    double x = from_offset * w.v + dt.v * per_w_c * w.u;
                    double v = dt.v * w.v - from_offset * w_c * w.u;
                    slow += offset_c + x;
                    slow_slope += v;
                    slow_bend = -square_c * x - most_second + square_c * swing;
                } else
                    slow_bend = -2.0 * c_np[2] - most_third * t;
            }
        }

        /* Its end. */
        struct motion at = sum(c_np, TIP_TERMS, end);
        if (together) {
            double top = dt.v > 0.0 ? d->m_fm * (g + square_c * swing) : 0.0;
            np = at;
            if (release && !strike) {
                dt.u = offset_c - lift;
                dt.v = -w_c * sqrt(swing * swing - lift * lift);
            } else {
                /* It passes its greatest force if the velocity turns before. */
                struct motion w = turn(w_c * end * (0.5 / M_PI));
                double x = from_offset * w.v + dt.v * per_w_c * w.u;
                double v = dt.v * w.v - from_offset * w_c * w.u;
                if (!(v < 0.0 || end * w_c > M_PI))
                    top = 0.0;
                top = fmax(top, d->m_fm * (g + square_c * fmax(from_offset, x)));
                dt.u = offset_c + x;
                dt.v = v;
            }
            force = fmax(force, top);
            fm = dt;
        } else {
            fm.u += end * (fm.v + 0.5 * g * end);
            fm.v += g * end;
            np.u = at.u + fm.u;
            np.v = at.v + fm.v;
            if (!at_rest)
                dt = sum(c_dt, TOOL_TERMS, end);
        }
        phase += f * end;
        phase -= floor(phase);
        hv = turn(phase);
        time += end;
        if (strike) {
            tip_closed = true;
            tool_closed = together;
            fm.u = fmax(fm.u, np.u + A * hv.u);
            if (together)
                dt.u = fm.u;
        } else if (fell) {
            tool_closed = true;
            fm.u = dt.u;
        } else if (release)
            released = true;
    }
    /* m u'' is the reacting force but for the blows of the free mass. */
    s.reacting_impulse = d->m_ud * (np.v - np_start - momentum);
    return s;
}

int main(int count, char **words)
{
    if (count != 23) {
        fprintf(stderr, "drill: expects 22 numbers\n");
        return 2;
    }
    double v[23];
    for (int i = 1; i < 23; i++)
        v[i] = atof(words[i]);
    struct motion np = {v[4], v[5]}, fm = {v[6], v[7]}, dt = {v[8], v[9]};
    struct drill d = {
        .in_rock = v[1] != 0.0, .m_ud = v[10], .c_1 = v[11], .k_1 = v[12], .m_fm = v[13],
        .m_dt = v[14], .c_2 = v[15], .k_2 = v[16], .e_1 = v[17], .e_2 = v[18], .W = v[19],
        .g = v[20], .A_0 = v[21], .f_0 = v[22],
    };
    struct timespec began, ended;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &began);
    struct statistics s = run(&d, v[2], v[3], np, fm, dt);
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &ended);
    double used = (ended.tv_sec - began.tv_sec) + 1e-9 * (ended.tv_nsec - began.tv_nsec);
    printf("{\"cpu_time\": %.9g, \"drill_tool_impact_rate\": %.9g, \"actuator_impact_rate\": %.9g, "
           "\"impact_velocity_mean\": %.9g, \"kinetic_energy_rate\": %.9g, "
           "\"contact_force_mean\": %.9g, \"reacting_force_mean\": %.9g, \"impact_times\": [",
           used, s.tool_impacts / v[2], s.tip_impacts / v[2], s.speed / s.tool_impacts,
           s.energy / v[2], s.force / s.tool_impacts, s.reacting_impulse / v[2]);
    for (int i = 0; i < KEPT && i < s.tool_impacts; i++)
        printf("%s%.17g", i ? ", " : "", times[i]);
    printf("]}\n");
    return 0;
}
