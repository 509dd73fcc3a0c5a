/* Coefficients of Rodas5P, a stiffly accurate, L-stable Rosenbrock method of order 5 [steinebach2023]. */
#ifndef STICKSLIP_RODAS5P_H
#define STICKSLIP_RODAS5P_H

#include "law.h"

#define RODAS_STAGES 8
/* Number of stages that are evaluated at nodes of their own; the later stages are evaluated at the end of the step. */
#define RODAS_INNER 5

#define RODAS_GAMMA R(0.21193756319429014)

/* a_ij: weights of the earlier stages in the state at which a stage is evaluated. */
static const real_t RODAS_A[6][RODAS_STAGES] = {
    {R(0.0)},
    {R(3.0)},
    {R(2.849394379747939), R(0.45842242204463923)},
    {R(-6.954028509809101), R(2.489845061869568), R(-10.358996098473584)},
    {R(2.8029986275628964), R(0.5072464736228206), R(-0.3988312541770524), R(-0.04721187230404641)},
    {R(-7.502846399306121), R(2.561846144803919), R(-11.627539656261098), R(-0.18268767659942256),
     R(0.030198172008377946)},
};

/* C_ij: weights of the earlier stages, over the step h, in the right-hand side of a stage. */
static const real_t RODAS_C[RODAS_STAGES][RODAS_STAGES] = {
    {R(0.0)},
    {R(-14.155112264123755)},
    {R(-17.97296035885952), R(-2.859693295451294)},
    {R(147.12150275711716), R(-1.41221402718213), R(71.68940251302358)},
    {R(165.43517024871676), R(-0.4592823456491126), R(42.90938336958603), R(-5.961986721573306)},
    {R(24.854864614690072), R(-3.0009227002832186), R(47.4931110020768), R(5.5814197821558125),
     R(-0.6610691825249471)},
    {R(30.91273214028599), R(-3.1208243349937974), R(77.79954646070892), R(34.28646028294783),
     R(-19.097331116725623), R(-28.087943162872662)},
    {R(37.80277123390563), R(-3.2571969029072276), R(112.26918849496327), R(66.9347231244047),
     R(-40.06618937091002), R(-54.66780262877968), R(-9.48861652309627)},
};

/* c_i: nodes of the stages, as fractions of the step; the last one is the middle of the step, for the error
 * estimate. */
static const real_t RODAS_NODES[7] = {
    R(0.0), R(0.6358126895828704), R(0.4095798393397535),
    R(0.9769306725060716), R(0.4288403609558664), R(1.0), R(0.5)};

/* d_i: weights of the partial derivative of the right-hand side by time. */
static const real_t RODAS_D[RODAS_INNER] = {
    R(0.21193756319429014), R(-0.42387512638858027), R(-0.3384627126235924),
    R(1.8046452872882734), R(2.325825639765069)};

/* Weights of the stages in the three rows of the continuous extension, which has order 4. */
static const real_t RODAS_H[3][RODAS_STAGES] = {
    {R(25.948786856663858), R(-2.5579724845846235), R(10.433815404888879), R(-2.3679251022685204),
     R(0.524948541321073), R(1.1241088310450404), R(0.4272876194431874), R(-0.17202221070155493)},
    {R(-9.91568850695171), R(-0.9689944594115154), R(3.0438037242978453), R(-24.495224566215796),
     R(20.176138334709044), R(15.98066361424651), R(-6.789040303419874), R(-6.710236069923372)},
    {R(11.419903575922262), R(2.8879645146136994), R(72.92137995996029), R(80.12511834622643),
     R(-52.072871366152654), R(-59.78993625266729), R(-0.15582684282751913), R(4.883087185713722)},
};

#endif
