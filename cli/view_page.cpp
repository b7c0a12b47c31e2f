// See view_page.h. The assembler takes the file in: three megabytes as a string would take long to generate and
// compile.
#include "cli/view_page.h"

asm(".pushsection .rodata\n"
    "cloam_viewer_page_begin: .incbin \"" CLOAM_VIEWER_PAGE
    "\"\n"
    "cloam_viewer_page_end: .byte 0\n"
    ".global cloam_viewer_page_begin, cloam_viewer_page_end\n"
    ".popsection\n");
extern "C" const char cloam_viewer_page_begin[], cloam_viewer_page_end[];

namespace cloam {

std::string viewer_page() { return {cloam_viewer_page_begin, cloam_viewer_page_end}; }

}  // namespace cloam
