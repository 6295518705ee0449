//! From a projector's calibration to the frustum that its rays leave by.
