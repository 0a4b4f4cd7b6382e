// Two of something, one a wheel.
#pragma once

template <typename T>
struct Wheels {
    T left;
    T right;
};
