// For programs that load plugins, under the address sanitizer: a library stays where it is when it is closed,
// so that what its own variables still hold at the end counts as held, and what leaks has its name.
extern "C" int dlclose(void*) {
    return 0;
}
