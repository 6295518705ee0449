// Shared by who measures the distance to occlusion edges and who uses it.
#ifndef EDGE_GLSL
#define EDGE_GLSL

// The distance from an occlusion edge at which a projector shines in full, px.
const float EDGE_REACH_PX = 12.0;

#endif
