// Which node; depth is the rasteriser's own.
#version 460

layout(location = 0) flat in float node;

layout(location = 0) out float seen;

void main() {
    seen = node;
}
