# The viewer's page: the target viewer_page makes ${CMAKE_BINARY_DIR}/generated/viewer.html, and that becomes a C++ source.
set(viewer_page ${CMAKE_BINARY_DIR}/generated/viewer.html)
set(viewer_page_source ${CMAKE_BINARY_DIR}/generated/viewer_page.cpp)

add_custom_command(OUTPUT ${viewer_page}
  COMMAND ${CMAKE_COMMAND} -E copy ${CMAKE_SOURCE_DIR}/web/placeholder.html ${viewer_page}
  DEPENDS ${CMAKE_SOURCE_DIR}/web/placeholder.html VERBATIM)
add_custom_target(viewer_page DEPENDS ${viewer_page})

add_custom_command(OUTPUT ${viewer_page_source}
  COMMAND ${CMAKE_COMMAND} -DFILE=${viewer_page} -DOUT=${viewer_page_source} -P ${CMAKE_SOURCE_DIR}/cmake/embed_page.cmake
  DEPENDS ${viewer_page} ${CMAKE_SOURCE_DIR}/cmake/embed_page.cmake VERBATIM)
