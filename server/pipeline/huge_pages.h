// Memory in huge pages. A frame walks through tens of megabytes once, so that its time is mostly that of
// finding them: on a virtual machine, where a miss of the TLB costs two walks, all stages were seen to take
// up to 1.7 times longer in small pages, the longer the machine had been up the more.
#pragma once

namespace kinevox {

// Starts the program anew with glibc told to ask for huge pages, which it hears from its environment at the
// start only; returns where there is nothing to do: it is told already (so is the second time), or not on
// Linux. The first thing that main() calls.
void restart_with_huge_pages(char** arguments);

}  // namespace kinevox
