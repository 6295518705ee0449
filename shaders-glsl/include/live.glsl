// Which pixels' looks depend on the eye, and how closely each must be looked at.
#ifndef LIVE_GLSL
#define LIVE_GLSL

#include "frame.glsl"

// A pixel's class, gathered over its samples: whether any of them shows something that depends on the eye, and whether they
// landed on different instances; the rest of the word is the first sample's instance.
const uint CLASS_EYE = 0x80000000u;
const uint CLASS_MIXED = 0x40000000u;
const uint CLASS_INSTANCE = 0x3fffffffu;

// Lists of pixels are walked by indirect dispatches of groups of so many lanes.
const uint LIVE_GROUP = 64u;
// Workgroups in x, after which they go on in y: every device takes 65,535 in each.
const uint LIVE_GROUPS_X = 32768u;

// Pixels a group where each sample of a group of planes has a lane.
uint each_pixels_a_group() {
    return LIVE_GROUP / setup.planes_a_group;
}

// Lanes of a pixel of which one sample was shaded before: that one has none, where all the samples lie side by side.
uint rest_lanes() {
    return setup.planes_a_group == setup.samples ? max(setup.planes_a_group - 1u, 1u) : setup.planes_a_group;
}

// How many groups hold so many pixels.
uint groups_of(uint pixels, uint pixels_a_group) {
    return (pixels + pixels_a_group - 1u) / pixels_a_group;
}

// Where in a list of pixels that are looked at sample by sample the `at`th of those stands of which one sample was shaded before: they are
// listed from its end, the others from its beginning.
uint rest_place(uint at) {
    return uint(frame.frustum.resolution_px.x) * uint(frame.frustum.resolution_px.y) - 1u - at;
}

// Columns and rows of workgroups that go as far as this one.
uvec2 live_groups_for(uint group) {
    return uvec2(min(group + 1u, LIVE_GROUPS_X), group / LIVE_GROUPS_X + 1u);
}

// Whether all samples of a pixel show the same thing, so that one of them may stand for all.
bool may_shade_once(uint pixel_class) {
    return setup.shade_once != 0u && (pixel_class & (CLASS_EYE | CLASS_MIXED)) == CLASS_EYE;
}

#endif
