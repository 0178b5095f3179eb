/* The mirror array plate in closed form, ray by ray. The numpy reference is core/light/plate.py. */

#include "kiriko.h"

#define GRAZING 1e-12 /* as in plate.py */
#define HALF_TURN 3.14159265358979323846

typedef enum { CROSSED, HOLES, RADIAL } Layout;

/* The effect of a layer of mirrors: displacement in pitches, reversal, and throughput. */
typedef struct {
    double moved, part;
    bool is_turned;
} Turned;

static bool is_odd(double n) { return fmod(n, 2.0) == 1.0; }

/* Reflection by the mirrors at their actual positions: one fold. */
static Turned as_mirrors(const Array *array, double q, double travel) {
    double slit = floor(q), unfolded = q + travel, into = floor(unfolded), n = fabs(into - slit);
    double inside = unfolded - into;
    bool odd = is_odd(n);
    Turned turned = {slit + (odd ? 1.0 - inside : inside) - q, pow(array->reflectance, n), odd};
    return turned;
}

/* Light with an odd number of reflections, averaged over all phases. */
static Turned as_one_mirror(const Array *array, double travel) {
    double share = 1.0 - fabs(fmod(fabs(travel), 2.0) - 1.0), number = 2.0 * floor(fabs(travel) / 2) + 1.0;
    Turned turned = {0.0, share * pow(array->reflectance, number), true};
    return turned;
}

static void leave(const Array *array, const double *place, double *local, double *position, double *direction) {
    double length = sqrt(dot(local, local));
    for (int j = 0; j < 3; j++) local[j] /= length;
    for (int j = 0; j < 3; j++) {
        position[j] = array->centre[j];
        direction[j] = 0;
        for (int k = 0; k < 2; k++) position[j] += array->axes[3 * k + j] * place[k];
        for (int k = 0; k < 3; k++) direction[j] += array->axes[3 * k + j] * local[k];
    }
}

/* Unit normals of the two directions of mirrors at a place, and offsets: added to its component along them, they
   give the distance from a mirror without phase. */
static void find_mirrors(const Array *array, const double *place, double normals[2][2], double *shift) {
    double angles[2] = {HALF_TURN / 4, 3 * HALF_TURN / 4 + array->crossing_error}, azimuth = 0, ring = 0;
    if (array->layout == RADIAL) {
        /* rings as wide as the holes' diagonal, each with holes side by side */
        double width = sqrt(2.0) * array->pitch;
        azimuth = atan2(place[1], place[0]);
        ring = width * rint(hypot(place[0], place[1]) / width);
    }
    for (int k = 0; k < 2; k++) {
        normals[k][0] = cos(azimuth + angles[k]);
        normals[k][1] = sin(azimuth + angles[k]);
        shift[k] = sin(angles[k]) * ring * azimuth - array->pitch * fmod(array->phase[k], 1.0);
    }
}

/* Transmit light through a plate of mirrors, or reflect it at the first face: sets its apparent origin, direction
   and path. Returns its throughput. */
double cross_array(const Array *array, Light light, double *position, double *direction, PlatePath *path) {
    double local[3], away[3], place[2];
    for (int k = 0; k < 3; k++) {
        local[k] = dot(array->axes + 3 * k, direction);
        away[k] = position[k] - array->centre[k];
    }
    double cosine = fabs(local[2]) > GRAZING ? fabs(local[2]) : GRAZING, side = local[2] < 0 ? -1.0 : 1.0;
    double n = array->ior, depth = sqrt((n - 1.0) * (n + 1.0) + cosine * cosine) / n;
    double to_face = 0.5 * array->thickness / cosine; /* from the middle plane to a face, per unit along the plate */
    double face = array->has_fresnel ? transmittance(cosine, depth, 1.0 / n) : 1.0;
    for (int k = 0; k < 2; k++) place[k] = dot(array->axes + 3 * k, away) - to_face * local[k];

    if (light == REFLECTED_LIGHT) {
        for (int k = 0; k < 2; k++) place[k] -= to_face * local[k];
        local[2] = -cosine * side;
        leave(array, place, local, position, direction);
        *path = REFLECTED;
        return 1.0 - face;
    }

    double normals[2][2], shift[2], throughput = face * face, drift = array->height / (n * depth);
    bool is_turned[2];
    find_mirrors(array, place, normals, shift);
    for (int turn = 0; turn < 2; turn++) {
        int which = side > 0 ? turn : 1 - turn; /* light against the normal meets the second layer first */
        const double *normal = normals[which];
        double speed = local[0] * normal[0] + local[1] * normal[1];
        double q = (place[0] * normal[0] + place[1] * normal[1] + shift[which]) / array->pitch;
        double travel = speed * drift / array->pitch;
        Turned turned = light == IMAGED_LIGHT ? as_one_mirror(array, travel) : as_mirrors(array, q, travel);
        double step = array->pitch * turned.moved;
        throughput *= turned.part;
        is_turned[which] = turned.is_turned;
        for (int k = 0; k < 2 && array->layout == CROSSED; k++) place[k] += drift * local[k];
        if (array->layout == CROSSED) step -= drift * speed; /* light drifts along the mirrors of slits */
        for (int k = 0; k < 2; k++) {
            place[k] += step * normal[k];
            if (turned.is_turned) local[k] -= 2.0 * speed * normal[k];
        }
    }
    for (int k = 0; k < 2; k++) place[k] -= to_face * local[k];
    local[2] = side * cosine;
    leave(array, place, local, position, direction);
    *path = is_turned[0] ? (is_turned[1] ? IMAGED : STRAY_1) : (is_turned[1] ? STRAY_2 : THROUGH);
    return throughput;
}
