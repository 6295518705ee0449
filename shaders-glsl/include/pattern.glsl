// Test patterns: what a projector shows instead of the scene while it is being set up. In 8-bit sRGB terms, unblended.
#ifndef PATTERN_GLSL
#define PATTERN_GLSL

const uint PATTERN_OFF = 0u;
const uint PATTERN_GRID = 1u;
const uint PATTERN_WHITE = 2u;
const uint PATTERN_BLACK = 3u;
const uint PATTERN_CHECKER = 4u;
const uint PATTERN_IDENTIFY = 5u;

// Side of a cell, px.
const int PATTERN_CELL_PX = 64;

// Which of the seven segments light for each digit: bit 0 top, 1 upper right, 2 lower right, 3 bottom, 4 lower left, 5 upper left,
// 6 middle.
const uint SEGMENTS[10] = uint[](0x3fu, 0x06u, 0x5bu, 0x4fu, 0x66u, 0x6du, 0x7du, 0x07u, 0x7fu, 0x6fu);

bool in_box(vec2 p, vec2 low, vec2 high) {
    return all(greaterThanEqual(p, low)) && all(lessThan(p, high));
}

// A digit in a box one wide and two high, strokes 0.2 thick.
bool in_digit(vec2 p, uint digit) {
    uint lit = SEGMENTS[digit];
    return (lit & 1u) != 0u && in_box(p, vec2(0.0, 0.0), vec2(1.0, 0.2)) ||
           (lit & 2u) != 0u && in_box(p, vec2(0.8, 0.0), vec2(1.0, 1.1)) ||
           (lit & 4u) != 0u && in_box(p, vec2(0.8, 0.9), vec2(1.0, 2.0)) ||
           (lit & 8u) != 0u && in_box(p, vec2(0.0, 1.8), vec2(1.0, 2.0)) ||
           (lit & 16u) != 0u && in_box(p, vec2(0.0, 0.9), vec2(0.2, 2.0)) ||
           (lit & 32u) != 0u && in_box(p, vec2(0.0, 0.0), vec2(0.2, 1.1)) ||
           (lit & 64u) != 0u && in_box(p, vec2(0.0, 0.9), vec2(1.0, 1.1));
}

// A frame one px wide and the diagonals' crossing marked: whether the whole image arrives, and where its middle is.
bool in_frame(ivec2 at, ivec2 size) {
    ivec2 from_middle = abs(2 * at + 1 - size);
    return any(equal(at, ivec2(0))) || any(equal(at, size - 1)) || min(from_middle.x, from_middle.y) <= 1 && max(from_middle.x, from_middle.y) < 64;
}

vec3 pattern_color(uint pattern, ivec2 at, ivec2 size, uint projector) {
    bool lit = pattern == PATTERN_WHITE;
    if (pattern == PATTERN_GRID) {
        lit = at.x % PATTERN_CELL_PX == 0 || at.y % PATTERN_CELL_PX == 0 || in_frame(at, size);
    } else if (pattern == PATTERN_CHECKER) {
        lit = ((at.x / PATTERN_CELL_PX + at.y / PATTERN_CELL_PX) & 1) == 0;
    } else if (pattern == PATTERN_IDENTIFY) {
        // The projector's number, counted from 1 in the configuration's order, half the image high.
        uint number = (projector + 1u) % 100u;
        vec2 p = (vec2(at) - 0.5 * vec2(size)) / (0.25 * float(size.y)) + vec2(0.0, 1.0);
        lit = number < 10u ? in_digit(p + vec2(0.5, 0.0), number)
                           : in_digit(p + vec2(1.2, 0.0), number / 10u) || in_digit(p - vec2(0.2, 0.0), number % 10u);
        lit = lit || in_frame(at, size);
    }
    return vec3(lit ? 1.0 : 0.0);
}

#endif
