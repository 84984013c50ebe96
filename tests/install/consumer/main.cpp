#include <cellmap/client/client.hpp>
#include <cellmap/geometry/lattice.hpp>
#include <iostream>

int main() {
  const cellmap::Lattice lattice({cellmap::LatticeKind::kFibonacci, 1000});
  cellmap::ClientOptions options;
  options.url = "http://127.0.0.1:8080";
  const cellmap::Client client(options);
  std::cout << to_string(lattice.spec()) << ' ' << lattice.nearest({0, 0, 1}) << '\n';
}
