// For programs that load plugins, under AddressSanitizer: libraries stay loaded after dlclose(), so that
// memory held by their variables is no leak and reports contain their symbols.
extern "C" int dlclose(void*) {
    return 0;
}
