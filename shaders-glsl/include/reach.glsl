// What a box that has moved can reach. All here may say yes where the truth is no, and never no where it is yes.
#ifndef REACH_GLSL
#define REACH_GLSL

// Boxes of each kind, of physical things and of virtual ones, at most; twin of daemon/render/src/moved.rs.
const uint MAX_BOXES = 16u;

struct Bounds {
    vec3 low;
    vec3 high;
};

// Narrows first ≤ s ≤ last to where a + s·b ≤ c.
void at_most(float a, float b, float c, inout float first, inout float last) {
    float s = (c - a) / b;
    if (b > 0.0) {
        last = min(last, s);
    } else if (b < 0.0) {
        first = max(first, s);
    } else if (a > c) {
        last = -1.0;
    }
}

// Whether any way from a point of `from` straight to `target` can meet `box`; where `directional`, the ways that run along `target`
// without end. For one s the points (1 − s) · from + s · target fill a box, which meets another where it does so on every axis; that
// is two inequalities an axis, linear in s.
bool reaches(Bounds from, vec3 target, bool directional, Bounds box) {
    float first = 0.0;
    float last = directional ? 3.0e38 : 1.0;
    for (int axis = 0; axis < 3; ++axis) {
        float from_low = directional ? target[axis] : target[axis] - from.low[axis];
        float from_high = directional ? target[axis] : target[axis] - from.high[axis];
        at_most(from.low[axis], from_low, box.high[axis], first, last);
        at_most(-from.high[axis], -from_high, -box.low[axis], first, last);
    }
    return first <= last;
}

#endif
