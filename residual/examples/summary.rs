//! Checks sets quickly.
use residual::spec::Spec;
use residual::{analyse, load};
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let spec = Spec::load(std::path::Path::new(&a[2])).unwrap_or_else(|e| panic!("{e}"));
    let data =
        load::load(&[std::path::PathBuf::from(&a[1])], &spec).unwrap_or_else(|e| panic!("{e}"));
    let report = analyse(&spec, data, &mut ()).unwrap_or_else(|e| panic!("{e}"));
    println!("{}", report.summary());
    for e in report.improves.iter() {
        println!("  I {} [{}] {}", e.name, e.form, e.unsupported);
    }
    for e in report.effects.iter() {
        println!("  E {} [{}] {:?} ci {:?}", e.name, e.form, e.params, e.ci);
    }
}
