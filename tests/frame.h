/* Frames of one unit vector, in numbers instead of lanes. */
#ifndef FRAME_H
#define FRAME_H
#include "../itn.h"

/* Two unit vectors s, t that make a right-handed frame with unit n (Duff et al. 2017). */
static inline void scalar_frame(itn_vec3 n, itn_vec3 *s, itn_vec3 *t) {
    float sign = n.z < 0 ? -1.f : 1.f, a = -1 / (sign + n.z), b = n.x * n.y * a;
    *s = itn__vec3(1 + sign * n.x * n.x * a, sign * b, -sign * n.x);
    *t = itn__vec3(b, sign + n.y * n.y * a, -n.y);
}
static inline itn_vec3 scalar_to_local(itn_vec3 v, itn_vec3 s, itn_vec3 t, itn_vec3 n) {
    return itn__vec3(itn__dot(v, s), itn__dot(v, t), itn__dot(v, n));
}
static inline itn_vec3 scalar_to_world(itn_vec3 v, itn_vec3 s, itn_vec3 t, itn_vec3 n) {
    return itn__along(itn__along(itn__scale(s, v.x), v.y, t), v.z, n);
}

#endif
