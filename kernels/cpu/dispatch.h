// How a file that Highway's foreach_target.h reads once a processor family, with its functions in a namespace
// of each, calls the one that fits the machine. Without Highway there is one form, in the namespace `plain`.
#pragma once

#ifdef KINEVOX_HAVE_HIGHWAY
#define KINEVOX_EXPORT(function) HWY_EXPORT(function)
#define KINEVOX_DISPATCH(function) HWY_DYNAMIC_DISPATCH(function)
#else
#define HWY_NAMESPACE plain
#define KINEVOX_EXPORT(function) static_assert(true)
#define KINEVOX_DISPATCH(function) plain::function
#endif
