#version 460
// Binds nothing and does nothing.
layout(local_size_x = 1) in;
void main() {}
