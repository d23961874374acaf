// Memory in huge pages. A frame set reads tens of megabytes once, so TLB misses dominate: on a virtual
// machine, where a miss costs two page walks, all stages took up to 1.7 times longer with small pages, more
// so the longer the machine had been up.
#pragma once

namespace kinevox {

// Restarts the program with glibc's tunable for huge pages, which is read from the environment at program
// start only; returns if it is set already (as after the restart) or not on Linux. Called first by main().
void restart_with_huge_pages(char** arguments);

}  // namespace kinevox
