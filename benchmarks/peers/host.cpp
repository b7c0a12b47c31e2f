// Plain C++ on all cores as a peer, where no library does the work.
#include "benchmarks/peers/peer.h"

int main() { return peer::serve({}); }
